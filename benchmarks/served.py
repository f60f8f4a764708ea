"""A server in a process of its own, and monitors that speak to it, for the benchmarks beside it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from websockets.asyncio.client import ClientConnection, connect

SPEC = """
id: soak
streams:
  - topic: /a
    signals: {v: msg.v}
properties:
  - {id: small, formula: 'not {v > 10}'}
  - {id: seen, formula: 'once[:10]{v: 1}'}
"""

NO_MORE: Mapping[str, str] = {}


class Server:
    """A server in a process of its own, with further specs by their ids; settings as in the environment."""

    def __init__(self, folder: Path, more: Mapping[str, str] = NO_MORE, **settings: str) -> None:
        specs = folder / "specs"
        specs.mkdir()
        for name, text in {"soak": SPEC, **more}.items():
            (specs / f"{name}.yaml").write_text(text)
        command = [sys.executable, "-m", "oracle_server", "serve", "--specs", str(specs), "--port", "0"]
        env = os.environ | {"ORACLE_DATA_DIR": str(folder / "data"), "ORACLE_LOG": "json"} | settings
        with (folder / "log").open("w") as written:
            self.process = subprocess.Popen(command, env=env, stderr=written)
        self._log = (folder / "log").open()  # a file of its own: of one, both would move the place
        self.port = 0
        while not self.port:
            time.sleep(0.05)
            self._log.seek(0)
            lines = [json.loads(line) for line in self._log if line.endswith("\n")]
            self.port = next((int(line["url"].rpartition(":")[2]) for line in lines if "url" in line), 0)

    def attach(self) -> connect:
        return self.dial(self.port)

    @staticmethod
    def dial(port: int) -> connect:
        url = f"ws://127.0.0.1:{port}/api/v1/attach"
        return connect(url, compression=None, proxy=None, ping_interval=None, open_timeout=60, max_queue=None)

    def stop(self) -> None:
        self.process.terminate()
        self.process.wait()
        self._log.close()

    @property
    def memory(self) -> float:
        """MB that are resident."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return next(int(line.split()[1]) / 1024 for line in status.splitlines() if line.startswith("VmRSS"))

    @property
    def files(self) -> int:
        """Files and sockets that are open."""
        return len(list(Path(f"/proc/{self.process.pid}/fd").iterdir()))


async def talk(socket: ClientConnection, session: str, events: int) -> None:
    """Attach, send so many events one by one, and wait until they are acked."""
    await socket.send(json.dumps(hello(session)))
    following = (await until(socket, "attached"))["next"]
    for seq in range(following, following + events):
        await socket.send(json.dumps(event(seq)))
    if events:
        await until_acked(socket, following + events - 1)


def hello(session: str, spec: str = "soak") -> dict[str, Any]:
    return {"type": "attach", "monitor": "m", "instance": "i", "session": session, "spec": spec}


def event(seq: int) -> dict[str, Any]:
    return {"type": "event", "seq": seq, "stream": "/a", "stamp": seq, "data": {"v": 1}}


async def until(socket: ClientConnection, kind: str) -> dict[str, Any]:
    """The next frame of a kind."""
    while True:
        frame: dict[str, Any] = json.loads(await socket.recv())
        if frame["type"] == kind:
            return frame
        assert frame["type"] != "error", frame


async def until_acked(socket: ClientConnection, seq: int) -> None:
    while (await until(socket, "ack"))["upto"] < seq:
        pass


def percentile(times: list[float], percent: float) -> float:
    ordered = sorted(times)
    return ordered[min(len(ordered) - 1, int(len(ordered) * percent / 100))]
