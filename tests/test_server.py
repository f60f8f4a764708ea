"""What the server does beside its sessions, and before it accepts work."""

from __future__ import annotations

import asyncio
import signal
import sys
from pathlib import Path

import pytest

from oracle_server.server import _tell_failure
from tests.processes import Process, environment

RESTORING = """\
import asyncio, sys
from oracle_server import server
from oracle_server.process.settings import load_settings

async def restore_all(registry):
    print("restoring", flush=True)
    await asyncio.Event().wait()

server.Registry.restore_all = restore_all
server.serve(load_settings(data_dir=sys.argv[1], port=0))
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_it_ends_where_it_is_told_to_while_it_restores(number: signal.Signals, tmp_path: Path) -> None:
    """As the first process of a container it was deaf to SIGTERM, and a second Ctrl-C was a traceback."""
    server = Process("the server", [sys.executable, "-c", RESTORING, tmp_path / "data"], environment())
    server.said("restoring")
    server.send(number)
    assert server.end(number) == 0
    assert "stopped before it accepted work" in server.log
    assert "Traceback" not in server.log


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
