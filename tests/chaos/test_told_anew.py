"""The one case in which a decision is recorded otherwise than it was told first; docs/fleet.md says when that is.

It takes two losses of PostgreSQL: one before the server that told it ends, and one of the server that goes on, after
the monitor was attached there and before the event was judged.
"""

from __future__ import annotations

import asyncio
import json
from contextlib import ExitStack, closing
from pathlib import Path

import httpx
from websockets.asyncio.client import ClientConnection

from tests.chaos.by_hand import attached, event, say, until_acked
from tests.chaos.link import Frame
from tests.chaos.served import Served
from tests.postgres import Postgres, Relay
from tests.processes import PATIENCE

SESSION = "s"
SPEC = """
id: guarded
streams:
  - {topic: /a, action: filter, decide_within: 1h, signals: {ok: msg.ok}}
properties:
  - {id: fine, guards: [/a], formula: '{ok: true}'}
"""
_QUICK = "from oracle_server.history.postgres import store; store.PATIENCE = 2.0"


async def decided(socket: ClientConnection, seq: int) -> Frame:
    """The decision on an event that is let through whatever it is, as its adapter has been told to before."""
    await say(socket, [event(seq, {"ok": True}) | {"stream": "/a", "ask": True}])
    while (frame := json.loads(await socket.recv()))["type"] != "decision":
        assert frame["type"] != "error", frame
    await socket.send(json.dumps({"type": "outcome", "seq": seq, "passed": True, "why": "decision"}))
    return dict(frame)


async def until(served: Served, status: int) -> None:
    async with asyncio.timeout(PATIENCE), httpx.AsyncClient(trust_env=False) as http:
        while (await http.get(f"{served.url}/readyz")).status_code != status:
            await asyncio.sleep(0.02)


async def test_what_was_told_is_unknown_where_postgresql_is_lost_once_more(postgres: Postgres, tmp_path: Path) -> None:
    with ExitStack() as stack:
        relays = {name: stack.enter_context(closing(Relay(postgres))) for name in "ab"}
        part, specs = postgres.part(), tmp_path / "specs"
        specs.mkdir()
        (specs / "guarded.yaml").write_text(SPEC)
        a, b = (
            Served(specs, tmp_path / name, prelude=_QUICK, history=postgres.past(relay, part), node=name, lease="1")
            for name, relay in relays.items()
        )
        async with a, b, asyncio.timeout(PATIENCE):
            async with attached(a, "guarded", SESSION, "m", ["/a"]) as socket:
                assert (await decided(socket, 1))["decision"] == "allow"
                await until_acked(socket, 1)
                relays["a"].fall_silent()
                assert (await decided(socket, 2))["decision"] == "allow"
                a.kill()
            while "node" in await b.get(f"sessions/{SESSION}"):
                await asyncio.sleep(0.02)
            async with attached(b, "guarded", SESSION, "m", ["/a"]) as socket:
                relays["b"].fall_silent()
                await until(b, 503)
                again = await decided(socket, 2)
                assert (again["decision"], again["verdicts"]) == ("deny", {"fine": "unknown"})
                relays["b"].speak()
                await until_acked(socket, 2)
                await until(b, 200)
                assert (await decided(socket, 3))["decision"] == "allow"
                await until_acked(socket, 3)
            told = [(r["outcome"], r["decision"], r["passed"]) for r in await b.records(SESSION)]
    assert told == [
        ("currently_true", "allow", True),
        ("unknown", "deny", True),
        ("currently_true", "allow", True),
    ]
