"""What an oracle has kept of a run: its trace and its verdict records, taken over HTTP, and kept as files."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.request import Request, urlopen

SESSION = "run"
Data = dict[str, Any]
_PATIENCE = 30
_PAGE = 1000


@dataclass(frozen=True)
class Kept:
    """A line for each event in the order of arrival, and a record for each verdict, and for each revision if any.

    `standing` are the verdicts as they stand at the end.
    """

    trace: list[Data]
    records: list[Data]
    standing: list[Data]

    def write(self, folder: Path) -> None:
        _write_lines(folder / "trace.jsonl", self.trace)
        _write_lines(folder / "records.jsonl", self.records)
        _write_lines(folder / "standing.jsonl", self.standing)


def read(folder: Path) -> Kept:
    return Kept(*(_read_lines(folder / f"{name}.jsonl") for name in ("trace", "records", "standing")))


def close(url: str, *, revising: bool) -> Kept:
    """Close the session, so that all is judged and final, and take what it has; `revising`: verdicts were revised."""
    session = f"{url}/api/v1/sessions/{SESSION}"
    _ask(Request(session, method="DELETE"))
    trace = [json.loads(line) for line in _ask(Request(f"{session}/trace")).splitlines()]
    if not revising:
        records = list(_records(session, ""))
        return Kept(trace, records, records)
    return Kept(trace, list(_records(session, "&as=all")), list(_records(session, "&as=standing")))


def _records(session: str, chosen: str) -> Iterator[Data]:
    after: int | None = 0
    while after is not None:
        page = json.loads(_ask(Request(f"{session}/verdicts?limit={_PAGE}&after={after}{chosen}")))
        yield from page["items"]
        after = page["next"]


def _ask(request: Request) -> bytes:
    with urlopen(request, timeout=_PATIENCE) as answer:
        body: bytes = answer.read()
        return body


def _write_lines(path: Path, lines: Iterable[Data]) -> None:
    path.write_text("".join(f"{json.dumps(line)}\n" for line in lines))


def _read_lines(path: Path) -> list[Data]:
    return [json.loads(line) for line in path.read_text().splitlines()]
