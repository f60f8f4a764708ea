"""What the server leaves to no other user of the machine, and to no page; and an end that takes too long."""

from __future__ import annotations

import asyncio
import re
import signal
from base64 import b64encode
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

from tests.chaos.served import Served
from tests.whole.client import attached, make_event
from tests.whole.conftest import Starts
from tests.whole.harness import PATIENCE, Server

STOPS_SOON = "from oracle_server import server; server._STOP_WITHIN = 0.1"
"""It gives what is under way less time to end."""


async def test_all_that_is_written_is_the_server_s_own(start: Starts) -> None:
    server = start()
    spec = "id: own\nstreams:\n  - topic: /a\nproperties:\n  - {id: p, formula: '{v: 1}'}\n"
    assert server.http.put("/api/v1/specs/own", content=spec).is_success
    async with attached(server, session="s", spec="single") as monitor:
        await monitor.send(make_event(1, data={"v": 1}))
        await monitor.acked(1)
        names = {path.name for path in server.data.rglob("*")}
        assert {"history.sqlite", "history.sqlite-wal", "history.sqlite-shm", "specs", "own.yaml"} <= names
        assert [str(path) for path in (server.data, *server.data.rglob("*")) if path.stat().st_mode & 0o077] == []
    assert server.stop(signal.SIGKILL) != 0
    for path in server.data.glob("history.sqlite*"):
        path.chmod(0o644)
    start()
    assert [str(path) for path in server.data.glob("history.sqlite*") if path.stat().st_mode & 0o077] == []


def test_the_pages_have_a_policy_that_runs_their_own_scripts_alone(server: Server) -> None:
    for path in ("/", "/docs"):
        answer = server.http.get(path)
        policy = answer.headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        (scripts,) = re.findall(r"script-src ([^;]*)", policy)
        assert "unsafe" not in scripts
        inline = re.findall(r"<script>(.*?)</script>", answer.text, re.DOTALL)
        hashes = {f"'sha256-{b64encode(sha256(one.encode()).digest()).decode()}'" for one in inline}
        assert set(scripts.split()) == {"'self'"} | hashes
        assert answer.headers["X-Content-Type-Options"] == "nosniff"


async def test_a_request_that_outlasts_the_server_is_cut_off_without_a_traceback(tmp_path: Path) -> None:
    specs = tmp_path / "specs"
    specs.mkdir()
    async with asyncio.timeout(PATIENCE), Served(specs, tmp_path / "data", STOPS_SOON) as served:
        reader, writer = await asyncio.open_connection("127.0.0.1", served.port)
        head = f"PUT /api/v1/specs/late HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\nContent-Length: 9\r\n"
        writer.write(f"{head}Expect: 100-continue\r\n\r\n".encode())
        assert b" 100 " in await reader.readline(), "the request is being read, and its body never comes"
        served.signal(signal.SIGTERM)
        with suppress(ConnectionError):
            await reader.read()
        writer.close()
        assert await served.ended() == 0
    log = "\n".join(map(str, served.log))
    assert "graceful shutdown exceeded" in log
    assert "cut off" in log
    assert "Traceback" not in log
