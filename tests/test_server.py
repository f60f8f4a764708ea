"""What the server does beside its sessions."""

from __future__ import annotations

import asyncio

import pytest

from oracle_server.server import _tell_failure


async def test_what_is_done_beside_the_sessions_does_not_end_in_silence(capsys: pytest.CaptureFixture[str]) -> None:
    async def fail() -> None:
        raise OSError("no more threads")

    async def go_on() -> None:
        await asyncio.Future()

    failing, ending = asyncio.create_task(fail(), name="Live.run"), asyncio.create_task(go_on())
    for task in (failing, ending):
        task.add_done_callback(_tell_failure)
    ending.cancel()
    await asyncio.wait((failing, ending))
    await asyncio.sleep(0)
    told = capsys.readouterr().out
    assert "is not done any more" in told
    assert "Live.run" in told
    assert "no more threads" in told
    assert told.count("is not done any more") == 1
