"""A restart expels nobody, whatever it takes, and one session that can't be restored stops no other."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Collection
from pathlib import Path
from typing import Any

import pytest
import structlog

from oracle_server.core.errors import UnansweredError
from oracle_server.core.plan import Plan
from oracle_server.history.episodes import EpisodeQuery
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.port import Done
from oracle_server.history.records import Document, SessionRecord
from oracle_server.process.clock import Clock
from oracle_server.review.restore import Restored, restore
from oracle_server.sessions import plans as plans_module
from oracle_server.sessions import registry as registry_module
from oracle_server.sessions.recorded import CUT_OFF, cut_off
from oracle_server.sessions.registry import Registry
from oracle_server.specfiles.library import Library
from oracle_server.wire.errors import WireError
from oracle_server.wire.incoming import Attach
from tests.history.backends import BACKENDS, Make
from tests.processes import PATIENCE
from tests.sessions.making import GUARD, Kept, attach, event, registry


@pytest.fixture
async def within() -> AsyncIterator[None]:
    async with asyncio.timeout(PATIENCE):
        yield


async def left(folder: Path) -> tuple[MemoryHistory, str]:
    """The history of a server that ended with three sessions, each with a monitor, and the name of a private one."""
    history = MemoryHistory()
    first = registry(history, folder, GUARD)
    for name in ("one", "two"):
        live, monitor = await first.attach(attach(name, "guard"), Kept())
        live.ingest(monitor, event(1, speed=1))
        live.ledger.write()
    private, _ = await first.attach(Attach(type="attach", monitor="m", instance="i", spec="guard"), Kept())
    await first.flush()
    return history, private.id


def impatient(history: MemoryHistory, folder: Path) -> Registry:
    """The next server, which keeps no place for any time at all."""
    return Registry(history, Library(None, folder), Clock(), resume_within=0.0)


def make_recording(history: MemoryHistory) -> None:
    """As if a recording had been judged in the first session."""
    kept = history._kept[1]
    kept.record = kept.record._replace(kind="recording")


async def present(history: MemoryHistory, number: int) -> list[bool]:
    return [monitor.attached for monitor in await history.monitors(number)]


@pytest.mark.usefixtures("within")
async def test_places_are_kept_until_work_is_accepted_however_long_that_takes(tmp_path: Path) -> None:
    history, private = await left(tmp_path)
    second = impatient(history, tmp_path)
    await second.restore_all()
    for _ in range(50):
        await asyncio.sleep(0)  # each turn is longer than a place would be kept
    await second.flush()
    assert set(second.open) == {"one", "two", private}
    assert [m.attached for live in second.open.values() for m in live.monitors.values()] == [True] * 3
    second.accept_work()
    one = second.open["one"]
    while one.monitors["m"].attached or private in second.open:
        await asyncio.sleep(0)
    await second.flush()
    assert await present(history, one.number) == [False]
    assert set(second.open) == {"one", "two"}


@pytest.mark.usefixtures("within")
@pytest.mark.parametrize(("seconds", "max_skew", "anew"), [(1800, "1s", True), (0.5, "0s", False), (1800, "1h", False)])
async def test_where_the_machines_clock_was_set_back_sessions_begin_anew_by_that(
    seconds: float, max_skew: str, anew: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All that came was late, and judged at one time, and deadlines ran out at once."""
    history, machine, spec = MemoryHistory(), time.time_ns, GUARD.replace("by: arrival", f"max_skew: {max_skew}")
    with monkeypatch.context() as ahead:
        ahead.setattr(time, "time_ns", lambda: machine() + int(seconds * 10**9))
        live, monitor = await registry(history, tmp_path, spec).attach(attach("one", "guard"), Kept())
        live.ingest(monitor, event(1, speed=1))
        live.close()
        await history.flush()
    second = Registry(history, Library(None, tmp_path), Clock(await history.last_time()), resume_within=3600)
    await second.restore_all()
    second.accept_work()
    if not anew:
        live, _ = await second.attach(attach("one", "guard"), Kept())
        assert live.id == "one"
        return
    with pytest.raises(WireError, match=r"the machine's clock was set back; attach to one\.run2") as refused:
        await second.attach(attach("one", "guard"), Kept())
    assert (refused.value.code, refused.value.session) == ("session_ended", "one.run2")
    live, _ = await second.attach(attach("one.run2", "guard"), Kept())
    assert live.clock.ahead == 0
    assert live.opened <= time.time_ns()


@pytest.mark.usefixtures("within")
async def test_who_is_back_before_work_is_accepted_keeps_its_place(tmp_path: Path) -> None:
    history, private = await left(tmp_path)
    second = impatient(history, tmp_path)
    await second.restore_all()
    live, monitor = await second.attach(attach("one", "guard"), Kept())
    second.accept_work()
    while private in second.open:
        await asyncio.sleep(0)
    assert live.monitors == {"m": monitor}
    assert monitor.attached


@pytest.mark.usefixtures("within")
@pytest.mark.parametrize("text", ["id: guard\nstreams: 3\n", "", GUARD.replace("speed > 3", "speed >")])
async def test_a_session_whose_spec_is_refused_now_stops_no_other(tmp_path: Path, text: str) -> None:
    history, private = await left(tmp_path)
    kept = history._kept[1]
    kept.record = kept.record._replace(text=text)
    second = impatient(history, tmp_path)
    with structlog.testing.capture_logs() as logs:
        await second.restore_all()
    assert set(second.open) == {"two", private}
    (told,) = [line for line in logs if line["event"] == "a session can't be restored"]
    assert told["session"] == "one"
    assert told["reason"]
    with pytest.raises(WireError, match="'one' could not be restored, and can only be read or closed: ") as refused:
        await second.attach(attach("one", "guard"), Kept())
    assert told["reason"].splitlines()[0] in refused.value.message
    assert "\n" not in refused.value.message


@pytest.mark.usefixtures("within")
async def test_whatever_goes_wrong_with_one_session_the_others_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    history, private = await left(tmp_path)

    async def fails(reading: Any, number: int, ready: Any) -> Any:
        if number == 2:
            raise RecursionError("too deep")
        return await restore(reading, number, ready)

    monkeypatch.setattr("oracle_server.sessions.registry.restore", fails)
    second = impatient(history, tmp_path)
    with structlog.testing.capture_logs() as logs:
        await second.restore_all()
    assert set(second.open) == {"one", private}
    assert [(line["session"], line["reason"]) for line in logs if line["log_level"] == "error"] == [
        ("two", "RecursionError: too deep")
    ]
    states = await second.states()
    assert [state["id"] for state in states] == [private, "one", "two"]
    assert states[-1] == await second.state("two")
    assert (states[-1]["status"], states[-1]["closed"]) == ("unrestored", None)
    assert states[-1]["trouble"] == "it could not be restored: RecursionError: too deep"
    assert states[-1].keys() == states[0].keys()


@pytest.mark.usefixtures("within")
async def test_a_recording_whose_rows_can_not_be_understood_keeps_no_session_from_going_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    history, private = await left(tmp_path)
    make_recording(history)

    async def fails(*_: object) -> Any:
        raise KeyError("odd")

    monkeypatch.setattr("oracle_server.sessions.recorded.committed", fails)
    second = impatient(history, tmp_path)
    await second.restore_all()
    assert set(second.open) == {"two", private}
    assert second.unrestored["one"].reason == "KeyError: 'odd'"


@pytest.mark.usefixtures("within")
async def test_the_session_of_a_recording_that_was_cut_off_is_known_while_it_is_being_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    history, _ = await left(tmp_path)
    make_recording(history)
    closing, waiting = history.close_session, asyncio.Event()

    def slow(session: int, at: int, state: Document, done: Done | None = None) -> None:
        """As on a slow disk: nothing of it is committed before `waiting` is set."""
        tasks.append(asyncio.create_task(later(session, at, state, done)))

    async def later(session: int, at: int, state: Document, done: Done | None) -> None:
        await waiting.wait()
        closing(session, at, state, done)

    tasks: list[asyncio.Task[None]] = []
    monkeypatch.setattr(history, "close_session", slow)
    second = impatient(history, tmp_path)
    await second.restore_all()
    before = await second.state("one")
    assert before is not None
    assert (before["status"], before["trouble"]) == ("closed", f"incomplete: {CUT_OFF}")
    assert [state for state in await second.states() if state["id"] == "one"] == [before]
    waiting.set()
    await asyncio.gather(*tasks)
    await second.flush()
    assert second.unrestored == {}
    assert await second.state("one") == before
    assert [state["id"] for state in await second.states()].count("one") == 1


@pytest.mark.usefixtures("within")
@pytest.mark.parametrize("backend", BACKENDS)
async def test_what_was_wrong_when_a_recording_was_cut_off_was_so_until_its_last_row(
    backend: str, make: Make, tmp_path: Path
) -> None:
    history = make(backend)
    first = registry(history, tmp_path, GUARD)
    live, monitor = await first.attach(attach("one", "guard"), Kept())
    for seq, speed in enumerate((1, 9, 8, 7), 1):
        live.ingest(monitor, event(seq, speed=speed))
    live.ledger.write()
    await first.flush()
    (row,) = [step async for page in history.steps(live.number, 3) for step in page]
    record = await history.session(live.number)
    assert record is not None
    state = await cut_off(record, history, live.clock.now())
    history.close_session(live.number, live.clock.now(), state, lambda: None)
    await first.flush()
    ((episode,), _) = await history.episodes(EpisodeQuery(session=live.number))
    assert (episode["open"], episode["first"], episode["last"]) == (False, 2, 4)
    assert episode["until"] == row.step.time
    assert episode["worst"] is not None
    assert (episode["count"], bool(episode["explanation"])) == (1, True)
    await asyncio.to_thread(history.close)


@pytest.mark.usefixtures("within")
async def test_a_session_that_could_not_be_restored_is_closed_for_good(tmp_path: Path) -> None:
    history, _ = await left(tmp_path)
    kept = history._kept[1]
    kept.record = kept.record._replace(text="id: guard\nstreams: 3\n")
    second = impatient(history, tmp_path)
    await second.restore_all()
    before = await second.state("one")
    assert before is not None
    assert await second.end("one", PATIENCE)
    assert second.unrestored == {}
    state = await second.state("one")
    assert state is not None
    assert state["trouble"] == before["trouble"], "why it was not judged to its end stays known"
    assert state == before | {"status": "closed"} | {
        k: state[k] for k in ("closed", "closed_because", "continued_by", "clock_went_back")
    }
    assert "one" not in [session.id for session in await history.open_sessions()]
    assert [s["id"] for s in await second.states()].count("one") == 1
    with pytest.raises(WireError, match=r"'one' is closed \(by request\); it can only be read"):
        await second.attach(attach("one", "guard"), Kept())
    third = impatient(history, tmp_path)
    await third.restore_all()
    assert third.unrestored == {}


@pytest.mark.usefixtures("within")
async def test_a_spec_is_read_once_for_all_its_sessions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    history, _ = await left(tmp_path)
    for kept in history._kept.values():
        kept.record = kept.record._replace(text=kept.record.text + "\n# as of some time ago\n")
    read: list[str] = []
    planned = plans_module._planned

    def counted(opened: SessionRecord) -> Any:
        read.append(opened.text)
        return planned(opened)

    monkeypatch.setattr(plans_module, "_planned", counted)
    second = impatient(history, tmp_path)
    await second.restore_all()
    assert len(second.open) == 3
    assert len(read) == 1


@pytest.mark.usefixtures("within")
async def test_one_of_which_the_history_does_not_answer_is_restored_by_the_next_try(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    history, private = await left(tmp_path)
    second = Registry(history, Library(None, tmp_path), Clock(), resume_within=3600)
    away = True

    async def taken(known: Collection[int]) -> list[SessionRecord]:
        return [record for record in await history.open_sessions() if record.number not in known]

    async def read(history: MemoryHistory, number: int, ready: Plan) -> Restored:
        record = await history.session("two")
        assert record
        if away and number == record.number:
            raise UnansweredError("PostgreSQL: the connection is closed")
        return await restore(history, number, ready)

    monkeypatch.setattr(history, "take_over", taken)
    monkeypatch.setattr(registry_module, "restore", read)
    with pytest.raises(UnansweredError):
        await second.take_over()
    assert "one" in second.open
    assert "two" not in second.open
    assert second.unrestored == {}
    one = second.open["one"]
    away = False
    await second.take_over()
    assert set(second.open) == {"one", "two", private}
    assert second.open["one"] is one
    live, _ = await second.attach(attach("two", "guard"), Kept())
    assert live.core.judges


async def test_one_that_is_opened_while_others_are_looked_for_is_not_restored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two would write to it else, each from where it stands."""
    history = MemoryHistory()
    own = registry(history, tmp_path, GUARD)
    asked, answered = asyncio.Event(), asyncio.Event()

    async def taken(known: Collection[int]) -> list[SessionRecord]:
        asked.set()
        await answered.wait()
        return [record for record in await history.open_sessions() if record.number not in known]

    monkeypatch.setattr(history, "take_over", taken)
    looking = asyncio.create_task(own.take_over())
    await asked.wait()
    live, _ = await own.attach(attach("one", "guard"), Kept())
    await own.flush()
    answered.set()
    await looking
    assert own.open == {"one": live}
