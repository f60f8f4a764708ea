"""Violations in the log are lines that people can read, whatever robots say."""

from __future__ import annotations

from typing import Any, cast

from structlog.testing import capture_logs

from oracle_server.core.records import VerdictRecord
from oracle_server.process.clock import Clock
from oracle_server.sessions.violations import ViolationLog


def logged(text: str) -> str:
    record: dict[str, Any] = {"n": 7, "property": "p", "explanation": {"text": text}}
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
