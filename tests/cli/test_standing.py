"""Verdicts that were revised, as tables and lines."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout
from typing import Any, cast

import pytest

from oracle_server.cli.client import Client
from oracle_server.cli.tables import follow_verdicts, show_verdicts

SECOND = 10**9
EVENT = {"stream": "/a", "kind": "topic", "monitor": "m", "seq": 3, "stamp": 4 * SECOND, "signals": {}}
SAID: dict[str, Any] = {
    "n": 3, "step": 3, "property": "p", "order": "publication", "outcome": "currently_false", "stream": "/a",
    "kind": "topic", "monitor": "m", "seq": 3, "stamp": 4 * SECOND, "arrived": 4 * SECOND, "judged": 4 * SECOND,
    "late": False, "skewed": False, "degraded": False, "decision": None, "passed": None, "robustness": None,
    "violation": True, "explanation": {"text": "p does not hold", "formula": "p", "event": EVENT},
    "released": "max_delay",
}  # fmt: skip
STANDS = SAID | {"outcome": "currently_true", "violation": False, "explanation": None, "revised": 9}
REVISION = SAID | STANDS | {
    "n": 9, "step": None, "kind": "revision", "stream": "", "monitor": "", "seq": -9,
    "arrived": 4 * SECOND + 310 * 10**6,
    "revises": {"from": 3, "to": 7}, "retracted": True, "causes": 2,
    "because": [{"monitor": "m1", "seq": 9, "stream": "/b", "kind": "topic", "stamp": 4 * SECOND}],
}  # fmt: skip
del REVISION["revised"]
STATE: dict[str, Any] = {
    "status": "open", "monitors": [],
    "properties": [
        {
            "id": "p", "order": "publication", "outcome": "currently_true", "first_violation": None, "violations": 0,
            "first_violation_step": None, "first_violation_at": None, "unknown": 0, "robustness": None, "caveats": [],
        }
    ]
}  # fmt: skip


class Told:
    """A client of a server that has these records, and keeps what it was asked."""

    def __init__(self, *records: dict[str, Any]) -> None:
        self.asked: list[str] = []
        self._records = list(records)

    def get(self, path: str, **_: object) -> dict[str, Any]:
        return STATE

    def pages(self, path: str, **query: Any) -> list[dict[str, Any]]:
        self.asked.append(query["as"])
        return self._records

    def events(self, path: str, note: Callable[[str], object], **query: Any) -> Iterator[dict[str, Any]]:
        yield from self.pages(path, **query)


def lines(show: Any, view: str, *records: dict[str, Any], outcomes: list[str]) -> list[str]:
    """What is printed of these records, without the columns' spaces."""
    client, out = Told(*records), io.StringIO()
    with redirect_stdout(out):
        show(cast("Client", client), "s", [], outcomes, view, as_json=False)
    assert client.asked == [view]
    return [" ".join(line.split()) for line in out.getvalue().splitlines()]


AT, NONE = "step time property outcome stream kind decision n", "1970-01-01"


def test_what_was_revised_names_the_revision() -> None:
    (head, row) = lines(show_verdicts, "standing", STANDS, outcomes=["currently_true"])
    assert head == AT
    assert row == "3 4.000 s p currently_true /a topic - by #9 3"


def test_revisions_say_what_they_are_of_and_why() -> None:
    found = lines(show_verdicts, "all", SAID, REVISION, outcomes=[])
    table, told = found[found.index("") + 1 :][:3], found[-2:]
    assert table[1:] == [
        "3 4.000 s p currently_false /a topic - 3",
        "- 4.000 s p currently_true revision - of #3 to #7 9",
    ]
    assert told == [
        "p does not hold (#3)",
        "retracted: p is not violated at verdict #3: /b (topic 9 of m1) came 310 ms late, and 1 more (#9)",
    ]  # fmt: skip


@pytest.mark.parametrize("outcome", ["currently_true", None])
def test_revisions_are_lines_among_those_that_are_followed(outcome: str | None) -> None:
    revision = REVISION | {"outcome": outcome, "retracted": False, "revises": {"from": 3, "to": 3}}
    waits = SAID | {"unheard": ["/b", "/c"]}
    assert lines(follow_verdicts, "standing", waits, revision, outcomes=[]) == [
        "3 4.000 s p currently_false /a topic - unheard: /b, /c 3",
        f"- 4.000 s p {outcome or '-'} revision - of #3 9",
    ]


def test_what_is_wrong_with_streams_is_told_where_it_may_hide_violations(monkeypatch: pytest.MonkeyPatch) -> None:
    past = "/rogue publishes /a past the monitor"
    told = [
        {"stream": "/a", "kind": "topic", "trouble": past, "bypass": past},  # told by the properties, if it matters
        {"stream": "/b", "kind": "topic", "trouble": "is of another type", "bypass": ""},
        {"stream": "/c", "kind": "topic", "trouble": "", "bypass": ""},
    ]
    monitors = [
        {"name": "m", "attached": True, "connected": True, "streams": told},
        {"name": "gone", "attached": False, "connected": False, "streams": told},
    ]
    monkeypatch.setitem(STATE, "monitors", monitors)
    assert lines(show_verdicts, "standing", outcomes=[])[-1] == "/b: is of another type"
    monkeypatch.setitem(STATE, "status", "closed")
    assert not any("another type" in line for line in lines(show_verdicts, "standing", outcomes=[]))
