"""A server that reads a data directory while an adapter in another process writes it."""

from __future__ import annotations

import asyncio
import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from oracle_adapter import Link, LinkError
from oracle_adapter.embedded import EmbeddedLink

from tests.processes import PATIENCE, environment, eventually
from tests.whole.conftest import copy_specs
from tests.whole.harness import Server, failed, problem, run

SPEC = """
id: guarded
ordering: {max_delay: none}
streams:
  - {topic: /a, action: filter, signals: {v: msg.v, odd: msg.v % 2 == 1}}
properties:
  - {id: even, formula: 'not {topic: "/a", odd}', guards: [/a]}
"""
ADAPTER = """
import sys
from oracle_adapter.embedded import EmbeddedLink, log_warnings

log_warnings()
link = EmbeddedLink(sys.argv[1], sys.argv[2], "m1", session="s", streams=["/a"])
link.start()
link.wait_attached(60)
print("attached", flush=True)
for line in sys.stdin:
    answer = link.ask("/a", "topic", None, {"v": int(line)}, decide_within=60).result(60)
    print("did", line.strip(), answer.decision, flush=True)
link.close(60)
"""


class Robot:
    """An adapter with an oracle of its own, in a process of its own."""

    def __init__(self, stack: ExitStack, spec: Path, data: Path) -> None:
        self.process = stack.enter_context(
            subprocess.Popen(
                [sys.executable, "-c", ADAPTER, spec, data],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment(),
            )
        )  # fmt: skip
        stack.callback(self.process.kill)
        assert self._line() == "attached"

    def ask(self, *numbers: int) -> None:
        """Ask about each, and have it decided."""
        for number in numbers:
            assert self.process.stdin is not None
            self.process.stdin.write(f"{number}\n")
            self.process.stdin.flush()
            assert self._line() == f"did {number} {'deny' if number % 2 else 'allow'}"

    def leave(self) -> None:
        """End in order."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        assert self.process.wait(PATIENCE) == 0

    def kill(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.process.wait(PATIENCE)

    def _line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    path = tmp_path / "guarded.yaml"
    path.write_text(SPEC)
    return path


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as made:
        yield made


@contextmanager
def beside(tmp_path: Path) -> Iterator[Server]:
    """A server that reads `own`."""
    specs = tmp_path / "specs"
    with Server(specs if specs.is_dir() else copy_specs(specs), tmp_path / "own", ORACLE_READ_ONLY="1") as server:
        yield server


def seen(server: Server, count: int) -> list[dict[str, Any]]:
    """The records of the session, once there are so many."""
    return eventually(lambda: server.records("s"), lambda found: len(found) == count)


def followed(server: Server, into: list[int], until: int) -> None:
    """Read the stream of verdicts up to a number."""
    with server.http.stream("GET", "/api/v1/sessions/s/stream") as stream:
        for line in stream.iter_lines():
            if line.startswith("data: "):
                into.append(json.loads(line[6:])["n"])
                if into[-1] == until:
                    return


async def test_what_an_adapter_writes_is_read_while_it_writes(stack: ExitStack, spec: Path, tmp_path: Path) -> None:
    robot = Robot(stack, spec, tmp_path / "own")
    robot.ask(2, 4, 5)
    server = stack.enter_context(beside(tmp_path))
    assert [r["outcome"] for r in seen(server, 3)] == ["currently_true"] * 2 + ["currently_false"]
    numbers: list[int] = []
    following = asyncio.create_task(asyncio.to_thread(followed, server, numbers, 9))
    await server.until(lambda: numbers, lambda found: len(found) == 3)  # what was there, and the stream goes on
    await asyncio.to_thread(robot.ask, *range(6, 12))
    await asyncio.wait_for(following, PATIENCE)
    assert numbers == list(range(1, 10))

    state = eventually(lambda: server.get("sessions/s"), lambda state: state["counters"]["steps"] == 9)
    assert (state["live"], state["node"], state["trouble"]) == (True, f"pid {robot.process.pid}", None)
    assert [(m["name"], m["attached"], m["connected"]) for m in state["monitors"]] == [("m1", True, True)]
    (even,) = state["properties"]
    assert (even["outcome"], even["violations"], even["first_violation"]) == ("currently_false", 4, 3)
    first = server.records("s")[2]
    assert (even["first_violation_step"], even["first_violation_at"]) == (first["step"], first["stamp"])
    assert [s["id"] for s in server.get("sessions")["items"]] == ["s"]
    episodes = server.get("sessions/s/episodes")["items"]
    assert (episodes[0]["first"], episodes[-1]["open"], sum(e["count"] for e in episodes)) == (3, True, 4)
    assert sum(server.get("sessions/s/timeline")["violations"]["even"]) == 4
    assert server.get("sessions/s/verdicts/3/explanation")["explanation"]["text"]
    assert len(server.http.get("/api/v1/sessions/s/trace").text.splitlines()) >= 9
    assert server.http.get("/readyz").json() == {"status": "read_only"}
    assert "oracle_history_writable 0" in server.http.get("/metrics").text
    assert server.http.get("/").status_code == 200
    reading = server.records("s")
    robot.leave()
    server.end()
    with Server(tmp_path / "specs", tmp_path / "own") as later:  # one that has the folder says the same
        assert later.records("s") == reading


def test_nothing_is_changed_by_who_reads(stack: ExitStack, spec: Path, tmp_path: Path) -> None:
    robot = Robot(stack, spec, tmp_path / "own")
    robot.ask(2)
    received = tmp_path / "own" / "recordings" / "kept"
    received.mkdir(parents=True)
    server = stack.enter_context(beside(tmp_path))
    seen(server, 1)
    refusals: list[httpx.Response] = [
        server.http.post("/api/v1/sessions", json={"spec": "guarded"}),
        server.http.delete("/api/v1/sessions/s"),
        server.http.put("/api/v1/specs/guarded", content=SPEC),
        server.http.post("/api/v1/recordings?spec=guarded", content=b"{}"),
    ]
    for refusal in refusals:
        assert "this server only reads" in problem(refusal, 405)["detail"]
    assert "only reads" in problem(server.http.get("/api/v1/sessions/s/episodes/stream"), 409)["detail"]
    for session in ("s", "another"):
        with (
            pytest.raises(LinkError, match="this server only reads") as refused,
            Link(server.url, "m2", spec="guarded", session=session) as link,
        ):
            link.wait_attached(PATIENCE)
        assert refused.value.code == "read_only"
    assert server.stop() == 0
    assert received.is_dir()
    robot.ask(3, 4)  # nobody has disturbed it
    robot.leave()


def test_a_killed_adapter_is_told_of_and_another_one_goes_on(stack: ExitStack, spec: Path, tmp_path: Path) -> None:
    robot = Robot(stack, spec, tmp_path / "own")
    robot.ask(2, 3)
    server = stack.enter_context(beside(tmp_path))
    seen(server, 2)
    robot.kill()
    state = server.get("sessions/s")
    assert (state["status"], state["live"], state["node"]) == ("open", False, None)
    assert "no process has its history open" in state["trouble"]
    assert [m["connected"] for m in state["monitors"]] == [False]
    server.end()
    server = stack.enter_context(beside(tmp_path))  # also begun where nobody writes, and a log was left behind
    assert len(server.records("s")) == 2
    again = Robot(stack, spec, tmp_path / "own")
    again.ask(4)
    assert [r["n"] for r in seen(server, 3)] == [1, 2, 3]
    assert server.get("sessions/s")["node"] == f"pid {again.process.pid}"
    again.leave()
    assert len(server.records("s")) == 3


def test_who_else_wants_to_write_is_told_what_to_do(stack: ExitStack, spec: Path, tmp_path: Path) -> None:
    data = tmp_path / "own"
    words = ("--data-dir", data, "--port", "0")
    assert "history.sqlite: is not there yet" in failed("serve", "--read-only", *words)
    robot = Robot(stack, spec, data)
    assert "or read it beside that by `oracle-server serve --read-only`" in failed("serve", *words)
    for command in ("stop", "start"):
        assert f"an adapter with --embedded (pid {robot.process.pid}) uses" in failed(command, *words[:2])
    stands = run("status", *words[:2], "--json")
    assert (stands.returncode, json.loads(stands.stdout)["state"]) == (3, "embedded")
    with pytest.raises(LinkError, match="another server, or an adapter with --embedded, uses this data directory"):
        EmbeddedLink(str(spec), str(data), "m2")
    assert "no sessions of its own: leave ORACLE_ALARMS out" in failed(
        "serve", "--read-only", *words, ORACLE_ALARMS=str(spec)
    )
    assert "use `oracle-server serve`" in failed("start", *words[:2], ORACLE_READ_ONLY="1")
