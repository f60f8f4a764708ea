"""A live session tells of which properties nothing was asked, also after a restart and where it revises."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from oracle_server.history.memory import MemoryHistory
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.monitor import Monitor
from oracle_server.sessions.registry import Registry
from oracle_server.sessions.status import session_state
from oracle_server.sessions.summary import brief, idle, told
from oracle_server.wire.incoming import Attach
from tests.processes import PATIENCE
from tests.sessions.making import Kept, event, registry

SPEC = """
id: spec
ordering: {ORDERING}
streams:
  - {topic: /mode, signals: {mode: msg.data}}
  - {topic: /cmd, signals: {speed: msg.x}}
properties:
  - {id: stops, formula: '{mode: FAULT} -> {speed: 0}'}
  - {id: slow, formula: '{topic: /cmd} -> {speed < 2}'}
  - {id: both, formula: '({mode: AUTO} and {speed > 1}) or (once {mode: LOST}) -> {speed: 0}'}
"""
NEVER = 'nothing was asked of stops (`{mode: "FAULT"}` never held)'
ORDERINGS = ("by: arrival", "late: revise, horizon: 60s", "by: both")


def make(history: MemoryHistory, folder: Path, ordering: str) -> Registry:
    return registry(history, folder, SPEC.replace("ORDERING", ordering))


async def attached(sessions: Registry, outbox: Kept) -> tuple[LiveSession, Monitor]:
    wanted = Attach(type="attach", monitor="m", instance="i", session="s", spec="spec", verdicts=True)
    return await sessions.attach(wanted, outbox)


def send(live: LiveSession, monitor: Monitor, seq: int, stream: str, **data: object) -> None:
    message = event(seq, stream).model_copy(update={"data": data, "stamp": live.clock.now() - 10**9 + seq})
    live.ingest(monitor, message)


def unasked(live: LiveSession) -> dict[str, str | None]:
    state = told(session_state(live, live.clock.now()))
    return {row["id"]: row["unasked"] for row in state["properties"]}


@pytest.mark.parametrize("ordering", ORDERINGS)
async def test_what_never_held_is_told_until_it_does(ordering: str, tmp_path: Path) -> None:
    sessions, outbox = make(MemoryHistory(), tmp_path, ordering), Kept()
    live, monitor = await attached(sessions, outbox)
    send(live, monitor, 1, "/mode", data="AUTO")
    live.core.release()
    live.core.advance(live.clock.now())
    assert unasked(live)["stops"] == '{mode: "FAULT"}'
    send(live, monitor, 2, "/cmd", x=0)
    send(live, monitor, 3, "/mode", data="FAULT")
    async with asyncio.timeout(PATIENCE):
        assert await sessions.closed_within(live, PATIENCE)
    state = await sessions.state("s")
    assert state is not None
    assert {row["unasked"] for row in state["properties"] if row["id"] in ("stops", "slow")} == {None}
    assert not [text for text in told(state)["remarks"] if "stops" in text]


@pytest.mark.parametrize("ordering", ORDERINGS)
@pytest.mark.parametrize("saved", [True, False])
async def test_it_is_told_after_a_restart_and_when_the_session_is_closed(
    ordering: str, saved: bool, tmp_path: Path
) -> None:
    history = MemoryHistory()
    first = make(history, tmp_path, ordering)
    live, monitor = await attached(first, Kept())
    send(live, monitor, 1, "/mode", data="AUTO")
    send(live, monitor, 2, "/cmd", x=1)
    await live.drain()
    live.closing = False
    live.ledger.write()
    if saved:
        live.ledger.save()
    await first.flush()
    before = unasked(live)
    assert before == {"stops": '{mode: "FAULT"}', "slow": None, "both": before["both"]}

    second = make(history, tmp_path, ordering)
    await second.restore_all()
    again = second.open["s"]
    assert unasked(again) == before
    async with asyncio.timeout(PATIENCE):
        assert await second.closed_within(again, PATIENCE)
    state = await second.state("s")
    assert state is not None
    assert brief(state)["unasked"] == f"nothing was asked of {', '.join(k for k, part in before.items() if part)}"
    (remark,) = told(state)["remarks"]
    assert remark.startswith(NEVER.removesuffix(")"))
    assert told(state)["doubts"] == []


def standing(outbox: Kept) -> dict[str, Any]:
    frames = [frame for frame in outbox.frames if frame["type"] == "verdicts"]
    return {name: one["text"] for name, one in frames[-1]["properties"].items()}


async def test_adapters_are_told_with_how_it_stands(tmp_path: Path) -> None:
    sessions, outbox = make(MemoryHistory(), tmp_path, "by: arrival"), Kept()
    live, monitor = await attached(sessions, outbox)
    send(live, monitor, 1, "/cmd", x=0)
    live.ledger.write()
    await sessions.flush()
    assert standing(outbox)["stops"] == "holds; nothing was asked of it yet"
    assert standing(outbox)["slow"] == "holds"
    send(live, monitor, 2, "/mode", data="LOST")
    send(live, monitor, 3, "/cmd", x=0)
    live.ledger.write()
    await sessions.flush()
    assert standing(outbox)["both"] == "holds"


async def test_what_an_older_version_kept_tells_nothing() -> None:
    row = {"id": "p", "outcome": "currently_true", "violations": 0}
    assert told({"properties": [row], "streams": [], "counters": {}, "status": "closed"})["remarks"] == []


def test_a_list_of_many_sessions_names_a_few() -> None:
    rows = [{"id": f"p{i}", "unasked": "{v}"} for i in range(5)]
    assert idle({"properties": [*rows, *rows]}) == "nothing was asked of p0, p1, p2 and 2 more"
    assert idle({"properties": []}) == ""
