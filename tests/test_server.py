"""What the server does beside its sessions, and before it accepts work."""

from __future__ import annotations

import asyncio
import signal
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from oracle_server.server import _tell_failure
from tests.processes import Process, environment
from tests.whole.client import connected, make_attach
from tests.whole.harness import Server

PROGRAM = """\
import asyncio, sys
from oracle_server import server
from oracle_server.process.settings import load_settings

async def restore_all(registry):
    print("restoring", flush=True)
    await asyncio.Event().wait()

async def attach(registry, wanted, outbox):
    raise RuntimeError("can't start new thread")

server.Registry.INSTEAD = INSTEAD
server.serve(load_settings(data_dir=sys.argv[1], port=0))
"""


def serving(instead: str, folder: Path) -> Process:
    """A server of which something is done as `PROGRAM` has it instead."""
    return Process("the server", [sys.executable, "-c", PROGRAM.replace("INSTEAD", instead), folder], environment())


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_it_ends_where_it_is_told_to_while_it_restores(number: signal.Signals, tmp_path: Path) -> None:
    """As the first process of a container it was deaf to SIGTERM, and a second Ctrl-C was a traceback."""
    server = serving("restore_all", tmp_path / "data")
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


async def test_who_attaches_where_threads_are_short_is_told_so(tmp_path: Path) -> None:
    """As in a container that may have few: the log had a traceback, as of a defect."""
    process = serving("attach", tmp_path / "data")
    server = cast(Server, SimpleNamespace(url=process.said(r"url=(http\S+)")[1]))
    async with connected(server) as monitor:
        await monitor.send(make_attach(spec="any"))
        (told,), code = await monitor.closed()
    assert (process.end(), code, told["code"]) == (0, 1008, "internal")
    for text in (told["message"], process.log):
        assert "more threads are needed than there are" in text
    assert "Traceback" not in process.log
