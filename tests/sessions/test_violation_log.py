"""Violations in the log are lines that people can read, whatever robots say."""

from __future__ import annotations

from typing import Any, cast

from structlog.testing import capture_logs

from oracle_server.core.records import VerdictRecord
from oracle_server.process.clock import Clock
from oracle_server.sessions.violations import ViolationLog


def logged(text: str) -> str:
    return line_of({"n": 7, "property": "p", "explanation": {"text": text}})


def line_of(record: dict[str, Any]) -> str:
    with capture_logs() as lines:
        ViolationLog("s", Clock()).add([cast("VerdictRecord", record)])
    (line,) = lines
    assert (line["session"], line["n"]) == ("s", 7)
    return str(line["event"])


def test_a_violation_is_logged_with_its_text() -> None:
    text = "p does not hold at step 1: " + "x" * 1000
    assert logged(text) == f"violation: {text}"


def test_a_text_of_a_megabyte_is_cut() -> None:
    for character in ("x", "\U000e0001"):
        line = logged("p does not hold at step 1: " + character * 10**6)
        assert line.startswith("violation: p does not hold at step 1: ")
        assert line.endswith("… (the history has all of it)")
        assert len(line) < 3000


def test_what_is_retracted_is_logged_with_the_event_that_came_late() -> None:
    cause = {"monitor": "m", "seq": 17, "stream": "/odom", "kind": "topic", "stamp": 10**18}
    record = {
        "n": 7,
        "property": "near",
        "retracted": True,
        "revises": {"from": 5, "to": 6},
        "arrived": 10**18 + 310 * 10**6,
    }
    assert line_of({**record, "because": [cause], "causes": 1}) == (
        "retracted: near is not violated at verdict #5: /odom (topic 17 of m) came 310 ms late"
    )
    cause["stamp"] = None
    assert line_of({**record, "because": [cause], "causes": 3}).endswith(
        ": /odom (topic 17 of m) came late, and 2 more"
    )
