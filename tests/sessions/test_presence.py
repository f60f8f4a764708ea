"""Sessions without monitors: idle after a while, closed where their spec says so, and begun anew by the same name."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from oracle_server.history.memory import MemoryHistory
from oracle_server.process.clock import Clock
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.presence import IDLE
from oracle_server.sessions.registry import Registry
from oracle_server.sessions.status import session_state
from oracle_server.sessions.summary import brief
from oracle_server.specfiles.library import Library
from oracle_server.wire.errors import WireError
from tests.processes import PATIENCE
from tests.sessions.making import GUARD, Kept, Standing, attach, event, registry

SECOND = 10**9
HOUR = 3600 * SECOND
BRIEF = f"{GUARD}close: after 20ms\n"
HOURLY = f"{GUARD}close: after 1h\n"
AWAITS = """
id: guard
close: after 20ms
streams: [{topic: /go, signals: {speed: msg.speed}}]
properties: [{id: stops, time: seconds, formula: '{speed > 3} -> eventually[:1h] {speed < 1}'}]
"""
PAIR = """
id: pair
streams: [{topic: /a, signals: {v: msg.v}}, {topic: /b, signals: {w: msg.w}}]
properties:
  - {id: about_a, formula: 'not {topic: /a, v > 3}'}
  - {id: about_b, formula: 'not {topic: /b, w > 3}'}
  - {id: about_both, formula: 'once {topic: /b} -> not {topic: /a, v > 3}'}
"""


@pytest.fixture(autouse=True)
async def within() -> AsyncIterator[None]:
    async with asyncio.timeout(PATIENCE):
        yield


async def closed(sessions: Registry, name: str) -> dict[str, object]:
    """The state of a session once it is closed."""
    while name in sessions.open:
        await asyncio.sleep(0.001)
    return await sessions.state(name) or {}


def state(live: LiveSession) -> dict[str, Any]:
    return session_state(live, live.clock.now())


async def test_a_session_is_live_with_a_monitor_and_idle_ten_minutes_after_the_last(tmp_path: Path) -> None:
    clock = Standing()
    sessions = registry(MemoryHistory(), tmp_path, GUARD, clock=clock)
    opened = await sessions.create("guard", "s")
    clock.time += IDLE - 1
    assert (state(opened)["live"], state(opened)["idle"]) == (False, False)
    clock.time += 1
    assert state(opened)["idle"], "nobody ever came"
    live, monitor = await sessions.attach(attach("s", "guard"), Kept())
    _, other = await sessions.attach(attach("s", "guard", "other", "j"), Kept())
    assert (state(live)["live"], state(live)["idle"], state(live)["without_monitor_since"]) == (True, False, None)
    live.detach(monitor)
    assert state(live)["live"]
    clock.time += IDLE
    live.detach(other)
    assert (state(live)["live"], state(live)["without_monitor_since"]) == (False, clock.time)
    clock.time += IDLE
    assert (state(live)["idle"], state(live)["status"]) == (True, "open")


async def test_a_session_is_closed_once_it_was_without_a_monitor_for_so_long(tmp_path: Path) -> None:
    sessions = registry(MemoryHistory(), tmp_path, BRIEF)
    live, monitor = await sessions.attach(attach("s", "guard"), Kept())
    live.ingest(monitor, event(1, speed=1))
    assert live.presence._timer is None, "nothing is counted while a monitor is there"
    live.detach(monitor)
    ended = await closed(sessions, "s")
    assert (ended["status"], ended["closed_because"]) == (
        "closed",
        "no monitor for 20ms (`close:` of its spec)",
    )
    assert (ended["live"], ended["idle"], ended["continued_by"]) == (False, False, None)
    never = await sessions.create("guard", "never")
    assert (await closed(sessions, never.id))["status"] == "closed", "nor did anybody come"


async def test_a_session_that_only_waits_for_deadlines_is_without_a_monitor(tmp_path: Path) -> None:
    sessions = registry(MemoryHistory(), tmp_path, AWAITS)
    live, monitor = await sessions.attach(attach("s", "guard"), Kept())
    live.ingest(monitor, event(1, speed=9))
    live.detach(monitor)
    assert live.core.next_deadline is not None
    assert (await closed(sessions, "s"))["status"] == "closed"


async def test_the_time_without_a_monitor_goes_on_over_a_restart(tmp_path: Path) -> None:
    clock, history = Standing(), MemoryHistory()
    sessions = registry(history, tmp_path, HOURLY, clock=clock)
    for name in ("left", "there"):
        live, monitor = await sessions.attach(attach(name, "guard"), Kept())
        live.ingest(monitor, event(1, speed=1))
        if name == "left":
            live.detach(monitor)
    await sessions.create("guard", "never")
    left = clock.time
    await sessions.shut_down()

    clock.time += HOUR
    later = Registry(history, Library(None, tmp_path), clock, resume_within=0.0)
    await later.restore_all()
    assert [later.open[name].presence.without_since for name in ("left", "there", "never")] == [left, None, left]
    assert set(later.open) == {"left", "there", "never"}, "nothing is closed before work is accepted"
    there = later.open["there"]
    later.accept_work()
    assert (await closed(later, "left"))["closed_because"] == "no monitor for 1h (`close:` of its spec)"
    assert (await closed(later, "never"))["status"] == "closed"
    while there.presence.is_live:
        await asyncio.sleep(0)
    assert there.presence.without_since == clock.time, "it was there until the server ended"
    assert "there" in later.open


async def joined(sessions: Registry, name: str, instance: str = "i") -> WireError:
    with pytest.raises(WireError) as refused:
        await sessions.attach(attach(name, "guard", instance=instance), Kept())
    return refused.value


async def test_the_name_of_a_session_that_was_left_begins_anew(tmp_path: Path) -> None:
    sessions = registry(MemoryHistory(), tmp_path, BRIEF)
    _, monitor = await sessions.attach(attach("s", "guard"), Kept())
    sessions.open["s"].detach(monitor)
    await closed(sessions, "s")
    assert (await joined(sessions, "s")).session == "s.run2"
    assert (await joined(sessions, "s", "j")).session == "s.run2", "all monitors are sent to the same one"
    second, monitor = await sessions.attach(attach("s.run2", "guard"), Kept())
    assert (state(second)["id"], state(second)["run"]) == ("s.run2", 2)
    told = await joined(sessions, "s", "j")
    assert (told.code, told.session) == ("session_ended", "s.run2")
    assert "no monitor for 20ms" in told.message
    second.detach(monitor)
    await closed(sessions, "s.run2")
    assert (await joined(sessions, "s")).session == "s.run3"
    assert (await joined(sessions, "s.run2")).session == "s.run3"


async def test_what_somebody_closed_begins_anew_for_a_new_process_alone(tmp_path: Path) -> None:
    sessions = registry(MemoryHistory(), tmp_path, GUARD)
    kept = Kept()
    await sessions.attach(attach("s", "guard"), kept)
    assert await sessions.end("s", PATIENCE)
    (told,) = await kept.expect("error")
    assert (told["code"], told["message"]) == ("session_closed", "session 's' was closed: by request")
    assert (await sessions.state("s") or {})["closed_because"] == "by request"
    assert (await joined(sessions, "s")).code == "session_closed", "it was told that this is over"
    assert (await joined(sessions, "s", "j")).session == "s.run2"


async def test_a_name_whose_first_run_was_deleted_goes_on_with_its_last(tmp_path: Path) -> None:
    history = MemoryHistory()
    sessions = registry(history, tmp_path, GUARD)
    await sessions.attach(attach("s", "guard"), Kept())
    number = sessions.open["s"].number
    assert await sessions.end("s", PATIENCE)
    await sessions.attach(attach("s.run2", "guard"), Kept())
    await history.forget_session(number)
    assert (await joined(sessions, "s", "j")).session == "s.run2"
    await sessions.attach(attach("s.run7", "guard"), Kept())  # a name of its own, whatever else there is
    assert (await joined(sessions, "s", "j")).session == "s.run7"


async def test_what_nobody_observes_any_more_is_told_while_others_are_there(tmp_path: Path) -> None:
    """A property about it holds on, since nothing breaks it: that is not known to be good."""
    history = MemoryHistory()
    sessions = registry(history, tmp_path, PAIR)
    live, first = await sessions.attach(attach("s", "pair", monitor="one", streams=["/a"]), Kept())
    _, second = await sessions.attach(attach("s", "pair", monitor="two", streams=["/b"]), Kept())
    assert told(live) == {"about_a": [], "about_b": [], "about_both": []}
    live.detach(second)
    lacks = ["no monitor observes /b any more"]
    assert told(live) == {"about_a": [], "about_b": lacks, "about_both": lacks}
    assert brief(state(live))["caveats"] == lacks

    await sessions.flush()
    later = Registry(history, Library(None, tmp_path), Clock(), resume_within=PATIENCE)
    await later.restore_all()
    assert told(later.open["s"])["about_b"] == lacks, "over a restart, too"

    _, third = await sessions.attach(attach("s", "pair", monitor="three"), Kept())
    assert told(live) == {"about_a": [], "about_b": [], "about_both": []}
    live.detach(first)
    live.detach(third)
    assert told(live) == {"about_a": [], "about_b": [], "about_both": []}, "nobody is there, which is told as such"


def told(live: LiveSession) -> dict[str, list[str]]:
    return {row["id"]: row["caveats"] for row in state(live)["properties"]}
