"""A server whose log nobody reads: a pager that waits, a terminal that is held, a supervisor that stands still."""

from __future__ import annotations

import fcntl
import subprocess
import time
from pathlib import Path

import httpx
from websockets.sync.client import connect

from oracle_server.wire.json import encode
from tests.processes import PATIENCE, environment, reserved_port
from tests.whole.client import make_attach, make_event
from tests.whole.conftest import copy_specs
from tests.whole.harness import COMMAND

ROBOTS = 100
"""Each opens a session, which takes two lines of some 90 characters: more than a pipe of one page holds."""


def test_it_decides_and_ends_all_the_same(tmp_path: Path) -> None:
    with reserved_port() as place:
        port = str(place.getsockname()[1])
        specs = copy_specs(tmp_path / "specs")
        command = [str(COMMAND), "serve", "--specs", str(specs), "--data-dir", str(tmp_path), "--port", port]
        with subprocess.Popen(command, env=environment(), stderr=subprocess.PIPE) as process:
            assert process.stderr is not None
            fcntl.fcntl(process.stderr, fcntl.F_SETPIPE_SZ, 4096)
            try:
                wait_until_ready(f"http://127.0.0.1:{port}")
                for robot in range(ROBOTS):
                    ask(f"ws://127.0.0.1:{port}/api/v1/attach", f"robot{robot}")
                process.terminate()
                assert process.wait(PATIENCE) == 0
            finally:
                process.kill()
            assert process.stderr.read().count(b"monitor attached") < ROBOTS


def wait_until_ready(url: str) -> None:
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            if httpx.get(f"{url}/readyz", trust_env=False).status_code == 200:
                return
        except httpx.TransportError:
            pass
        assert time.monotonic() < deadline
        time.sleep(0.05)  # between two questions


def ask(url: str, session: str) -> None:
    """Attach, ask for one decision, and hear it."""
    with connect(url, proxy=None, open_timeout=PATIENCE) as socket:
        socket.send(encode(make_attach(session=session, spec="lamp", streams=["/light"])))
        socket.send(encode(make_event(1, "/light", data={"level": 3}, ask=True)))
        while '"decision"' not in str(socket.recv(PATIENCE)):
            pass
