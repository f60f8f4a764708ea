"""How a session stands by its rows alone is how it stood when these were judged."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest

from oracle_server.history.memory import MemoryHistory
from oracle_server.history.records import SessionRecord
from oracle_server.jobs.frames import Failed, Rows, Started, Task
from oracle_server.jobs.judging import judge
from oracle_server.sessions import last as module
from oracle_server.sessions.committed import committed
from oracle_server.sessions.unrestored import bare
from oracle_server.specfiles.load import parse_spec
from tests.whole.conftest import SPECS

ALIKE = (
    "id", "order", "outcome", "violations", "first_violation", "first_violation_step", "first_violation_at", "pending",
)  # fmt: skip


def judged(name: str, folder: Path, count: int) -> tuple[str, list[Any]]:
    """The spec of a name, and what is told of a log that breaks off after so many events, some of them late."""
    path, told = folder / "log.jsonl", list[Any]()
    with path.open("w", encoding="utf-8") as file:
        for i in range(count):
            late, at = i % 9 == 4, 10**18 + i * 10**8
            stamp, value = at - late * 5 * 10**8, 11 if i % 4 == 3 else i // 2 % 5
            line = {"stream": "/a" if i % 2 or late else "/b", "stamp": stamp, "arrived": at, "data": {"v": value}}
            file.write(f"{json.dumps(line)}\n")
        file.write("{garbage\n")
    text = (SPECS[0] / f"{name}.yaml").read_text(encoding="utf-8")
    judge(Task(bytes(path), path.name, text, [], 10**9), told.append)
    return text, told


@pytest.mark.parametrize("name", ["single", "both", "revising", "deadline"])
@pytest.mark.parametrize("page", [1_000, 7])
async def test_it_stands_as_it_was_judged(
    page: int, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_PAGE", page)
    text, told = await asyncio.to_thread(judged, name, tmp_path, 41)
    spec = parse_spec(text, "spec").spec
    (started,) = [frame for frame in told if isinstance(frame, Started)]
    names = tuple(prop.id for prop in spec.properties)
    record = SessionRecord(1, "s", spec.id, text, spec.digest, names, False, 1, decides=started.decides)
    history = MemoryHistory()
    history.start(asyncio.get_running_loop())
    history.open_session(record)
    for rows in (frame for frame in told if isinstance(frame, Rows)):
        history.append(1, rows.steps, lambda: None, rows.revisions, rows.episodes)
    await history.flush()
    failed = told[-1]
    assert isinstance(failed, Failed)
    assert failed.state is not None
    assert any(prop["violations"] for prop in failed.state["properties"])
    alone, beside = [await committed(history, record, before) for before in (bare(record), bare(record) | failed.state)]
    for found in (alone, beside):
        assert [{key: prop[key] for key in ALIKE} for prop in found["properties"]] == [
            {key: prop[key] for key in ALIKE} for prop in failed.state["properties"]
        ]
        assert found["counters"]["steps"] == failed.state["counters"]["steps"]
    assert [prop["unknown"] for prop in beside["properties"]] == [p["unknown"] for p in failed.state["properties"]]
    assert {prop["unknown"] for prop in alone["properties"]} == {None}
    history.close()


async def test_where_no_row_is_kept_nothing_is_known_to_hold(tmp_path: Path) -> None:
    text, _ = await asyncio.to_thread(judged, "single", tmp_path, 1)
    record = SessionRecord(1, "s", "single", text, "digest", ("a_is_small",), False, 1)
    history = MemoryHistory()
    history.start(asyncio.get_running_loop())
    history.open_session(record)
    await history.flush()
    found = await committed(history, record, bare(record))
    assert [(prop["outcome"], prop["violations"]) for prop in found["properties"]] == [("unknown", 0)]
    assert found["counters"]["steps"] == 0
    history.close()
