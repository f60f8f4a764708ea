"""Three servers over one PostgreSQL, two robots that know all of them, and a server that is killed.

Prints what happens, and compares what the robots were told with the history. Ends with 0 where nothing was lost.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from urllib.parse import urlencode
from urllib.request import urlopen

from tests.postgres import Postgres, programs
from tests.processes import PATIENCE, ROOT, Process, all_pages, environment, eventually, held_port

EVENTS = 400
"""Of each robot, in 8 s."""
LEASE = "1.5"
SESSIONS = ("robot1", "robot2")
ROBOT = ROOT / "examples" / "forklift" / "robot.py"
_SERVER = Path(sys.executable).parent / "oracle-server"
Nodes = dict[str, tuple[Process, str]]
"""Servers and where they are, by their names."""


def main() -> int:
    """Show it; 0 where nothing was lost."""
    if programs() is None:
        print("oracle-server: PostgreSQL is missing; install it (Debian: apt-get install postgresql)", file=sys.stderr)
        return 2
    try:
        with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
            return _show(Path(name), stack)
    except (AssertionError, OSError) as error:
        print(f"oracle-server: the demo failed: {error}", file=sys.stderr)
        return 1


def _show(folder: Path, stack: ExitStack) -> int:
    say("PostgreSQL, in a temporary folder")
    postgres = stack.enter_context(Postgres())
    say(f"three servers over it, each with a lease of {LEASE} s")
    nodes = _servers(postgres.empty(), folder, stack)
    for name, (_, url) in nodes.items():
        print(f"   {name}  {url}")
    urls = [url for _, url in nodes.values()]
    say("two robots, which know all three, and ask whether they may drive")
    robots = {}
    for session, first in zip(SESSIONS, (0, 1), strict=True):
        robots[session] = _robot(session, urls[first:] + urls[:first], folder, stack)
    for robot in robots.values():
        robot.said("attached")
    where = {session: owner(nodes, "a", session) for session in SESSIONS}
    for session, node in where.items():
        print(f"   {session} is at {node}")
    killed = where[SESSIONS[0]]
    eventually(lambda: len(_lines(folder, SESSIONS[0])), lambda count: count > EVENTS // 8)
    say(f"kill -9 of {killed}, while they drive")
    nodes[killed][0].remove()
    begun = time.monotonic()
    left = next(name for name in nodes if name != killed)
    heir = eventually(lambda: owner(nodes, left, SESSIONS[0]), lambda node: node != killed)
    print(f"   {heir} has taken over {SESSIONS[0]} after {time.monotonic() - begun:.1f} s")
    say("the robots, once they have driven")
    statuses = [robot.wait() for robot in robots.values()]
    for robot in robots.values():
        print(f"   {robot.log.splitlines()[-1]}")
    say("what they were told, beside the history")
    sound = [_compare(nodes[left][1], folder, session) for session in SESSIONS]
    if any(statuses) or not all(sound):
        print("oracle-server: something was lost", file=sys.stderr)
        return 1
    say("nothing that was acked is lost, nothing is there twice, and what was told is what is kept")
    return 0


def _servers(url: str, folder: Path, stack: ExitStack) -> Nodes:
    started = {}
    for name in "abc":
        port = held_port(stack)
        settings = environment(
            ORACLE_HISTORY=url, ORACLE_NODE=name, ORACLE_LEASE=LEASE, ORACLE_ADVERTISE=f"http://127.0.0.1:{port}"
        )
        words = ["--specs", ROBOT.parent, "--data-dir", folder / name, "--port", port]
        started[name] = Process(name, [_SERVER, "serve", *words], settings), f"http://127.0.0.1:{port}"
        stack.callback(started[name][0].remove)
    for process, _ in started.values():
        process.said("accepting work")
    return started


def _robot(session: str, urls: list[str], folder: Path, stack: ExitStack) -> Process:
    words = ["--oracle", ",".join(urls), "--session", session, "--events", EVENTS, "--told", folder / session]
    path = f"{ROOT / 'adapters' / 'common'}"
    robot = Process(session, [sys.executable, ROBOT, *words], environment(PYTHONPATH=path))
    stack.callback(robot.remove)
    return robot


def _compare(url: str, folder: Path, session: str) -> bool:
    """Whether each event is there once, with what was decided; robots end with 0 only once all is acked."""
    records = all_pages(lambda path, **query: get(url, path, **query), f"sessions/{session}/verdicts", {})
    once = sorted(record["seq"] for record in records) == list(range(1, EVENTS + 1))
    kept = {record["seq"]: record["decision"] for record in records if record["decision"] is not None}
    told = {line["seq"]: line["decision"] for line in _lines(folder, session)}
    print(f"   {session}: {EVENTS} acked, {len(records)} kept, {'each once' if once else 'NOT each once'};", end=" ")
    print(f"{len(told)} decisions told, {sum(kept.get(seq) == what for seq, what in told.items())} of them kept so")
    return once and told == kept


def _lines(folder: Path, session: str) -> list[Any]:
    path = folder / session
    whole = path.read_text().rpartition("\n")[0] if path.exists() else ""
    return [json.loads(line) for line in whole.splitlines()]


def owner(nodes: Nodes, asked: str, session: str) -> str:
    """The node that has a session, as a server tells it, which names itself by nothing."""
    return str(get(nodes[asked][1], f"sessions/{session}").get("node", asked))


def get(url: str, path: str, **query: Any) -> Any:
    """A document of the API."""
    with urlopen(f"{url}/api/v1/{path}?{urlencode(query)}", timeout=PATIENCE) as answer:
        return json.load(answer)


def say(what: str) -> None:
    """A step."""
    print(f"== {what}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
