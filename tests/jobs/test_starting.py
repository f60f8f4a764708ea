"""What is told where the system starts no process for what is asked."""

from __future__ import annotations

import sys

import pytest

from oracle_server.jobs.checking import Checking, UncheckedError
from oracle_server.jobs.frames import Task
from oracle_server.jobs.judge import Judge, JudgeError


async def test_where_no_process_is_started_that_is_told_and_is_no_defect(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a container that may have no more, or where the environment was replaced below a server."""
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    why = "the system starts no process for it: No such file or directory"
    checking = Checking()
    try:
        with pytest.raises(UncheckedError, match=f"^the spec can't be checked: {why}$"):
            await checking.check("a", "id: a")
    finally:
        checking.close()
    with pytest.raises(JudgeError, match=f"^{why}$"):
        await anext(Judge(Task(b"log.jsonl", "log.jsonl", "id: a", [], 1)).frames())
