"""A session that could not be closed goes on, and ends later where it is over."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from oracle_server.core.errors import HistoryError
from oracle_server.core.verdicts import Judged
from oracle_server.history.memory import MemoryHistory
from oracle_server.process.clock import Clock
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.monitor import Monitor
from oracle_server.sessions.registry import Registry, SessionStaysOpenError
from oracle_server.specfiles.library import Library
from oracle_server.wire.incoming import Attach, ClockMessage, ClockStamp
from tests.processes import PATIENCE
from tests.sessions.making import GUARD, Kept, Standing, attach, event

SOON = """
id: soon
streams:
  - topic: /asked
  - topic: /answered
properties:
  - id: soon
    formula: '{topic: "/asked"} -> eventually[:1s] {topic: "/answered"}'
    time: seconds
"""


class FailsOnce:
    """A `settle` that fails once it may, and then does nothing."""

    def __init__(self) -> None:
        self.going, self.runs = asyncio.Event(), 0

    async def __call__(self, _: LiveSession) -> None:
        self.runs += 1
        await self.going.wait()
        if self.runs == 1:
            raise HistoryError("the history can't be read: disk I/O error")


@pytest.fixture
def settle(monkeypatch: pytest.MonkeyPatch) -> FailsOnce:
    made = FailsOnce()

    async def settle(session: LiveSession) -> None:
        await made(session)

    monkeypatch.setattr(LiveSession, "settle", settle)
    return made


def serving(folder: Path, clock: Clock | None = None) -> Registry:
    library, history = Library(None, folder), MemoryHistory()
    library.put("guard", GUARD)
    library.put("soon", SOON)
    history.start(asyncio.get_running_loop())
    return Registry(history, library, clock or Clock(), resume_within=0.01)


async def gone(sessions: Registry) -> None:
    async with asyncio.timeout(PATIENCE):
        while sessions.open:
            await asyncio.sleep(0.001)


async def test_a_private_session_ends_though_it_could_not_be_closed_at_first(tmp_path: Path, settle: FailsOnce) -> None:
    sessions = serving(tmp_path)
    settle.going.set()
    live, monitor = await sessions.attach(Attach(type="attach", monitor="m", instance="i", spec="guard"), Kept())
    live.detach(monitor)
    await gone(sessions)
    assert settle.runs == 2


async def test_a_monitor_that_went_meanwhile_is_not_waited_for_for_ever(tmp_path: Path, settle: FailsOnce) -> None:
    sessions = serving(tmp_path)
    outbox = Kept()
    live, monitor = await sessions.attach(Attach(type="attach", monitor="m", instance="i", spec="guard"), outbox)
    live.disconnected(monitor, outbox)
    settle.going.set()
    with pytest.raises(SessionStaysOpenError):
        await sessions.closed_within(live, PATIENCE)
    await gone(sessions)


async def test_who_attaches_to_a_session_that_can_not_be_closed_is_taken(tmp_path: Path, settle: FailsOnce) -> None:
    sessions = serving(tmp_path)
    live, _ = await sessions.attach(attach("s", "guard"), Kept())
    closing = asyncio.ensure_future(sessions.closed_within(live, PATIENCE))
    async with asyncio.timeout(PATIENCE):
        while not settle.runs:
            await asyncio.sleep(0)
        attaching = asyncio.ensure_future(sessions.attach(attach("s", "guard", monitor="n"), outbox := Kept()))
        await asyncio.sleep(0)
        settle.going.set()
        with pytest.raises(SessionStaysOpenError):
            await closing
        found, monitor = await attaching
    assert found is live
    live.ingest(monitor, event(1, ask=True, speed=9))
    assert (await outbox.expect("decision"))[0]["decision"] == "deny"


@pytest.mark.parametrize("closes", [True, False])
async def test_who_leaves_while_a_session_closes_lets_no_time_pass(
    tmp_path: Path, settle: FailsOnce, *, closes: bool
) -> None:
    """Events are not taken any more, so that a deadline which is over meanwhile was perhaps met."""
    clock = Standing()
    sessions = serving(tmp_path, clock)
    live, monitor = await sessions.attach(attach("s", "soon"), Kept())
    live.ingest(monitor, event(1, "/asked"))
    live.update_clocks(monitor, ClockMessage(type="clock", stamps=[ClockStamp(stream="/answered", stamp=clock.time)]))
    settle.runs = int(closes)
    closing = asyncio.ensure_future(sessions.closed_within(live, PATIENCE))
    async with asyncio.timeout(PATIENCE):
        while settle.runs == closes:
            await asyncio.sleep(0)
        clock.time += 60 * 10**9
        live.detach(monitor)
        settle.going.set()
        (told,) = await asyncio.gather(closing, return_exceptions=True)
    found = live.core.judges["publication"].properties[0]
    assert isinstance(told, SessionStaysOpenError) is not closes
    assert (found.outcome, found.violations) == (("currently_true", 0) if closes else ("currently_false", 1))


async def test_one_that_fails_as_the_server_stops_leaves_the_others_in_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sessions = serving(tmp_path)
    bad, good = [await sessions.attach(attach(name, "guard"), Kept()) for name in ("bad", "good")]
    monkeypatch.setattr(bad[0].core, "finish", _fails)
    good[0].ingest(good[1], event(1, speed=1))
    await sessions.shut_down()
    assert [frame["upto"] for frame in _frames(good[1], "ack")] == [1]
    assert [_frames(monitor, "error")[-1]["code"] for _, monitor in (bad, good)] == ["shutting_down"] * 2


def _fails(_now: int) -> list[Judged]:
    raise OverflowError("cannot fit 'int' into an index-sized integer")


def _frames(monitor: Monitor, kind: str) -> list[dict[str, Any]]:
    assert isinstance(monitor.outbox, Kept)
    return [frame for frame in monitor.outbox.frames if frame["type"] == kind]
