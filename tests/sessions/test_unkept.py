"""A session of which something can't be kept is judged no more, and says so; the others notice nothing."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Sequence
from pathlib import Path
from typing import Any

import msgspec
import pytest

from oracle_server.core.revisions import Revision
from oracle_server.core.verdicts import Judged
from oracle_server.history.episodes import StoredEpisode
from oracle_server.history.port import Done
from oracle_server.history.records import SessionRecord, StoredStep, stored
from oracle_server.history.sqlite.history import SqliteHistory
from oracle_server.process.clock import Clock
from oracle_server.sessions import keeping as keeping_module
from oracle_server.sessions import ledger as ledger_module
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.monitor import Monitor
from oracle_server.sessions.registry import Registry
from oracle_server.specfiles.library import Library
from oracle_server.wire.errors import WireError
from tests.processes import PATIENCE
from tests.sessions.making import GUARD, Kept, attach, event, registry

BAD = 13
"""The speed of an event whose row can't be kept."""


class Choosy(SqliteHistory):
    """A history that gets some steps with an integer that SQLite refuses."""

    def append(
        self, session: int, steps: Sequence[StoredStep], done: Done, revisions: Sequence[Revision] = (),
        episodes: Sequence[StoredEpisode] = (),
    ) -> None:  # fmt: skip
        spoiled = [_spoiled(s) if s.step.signals.get("speed") == BAD else s for s in steps]
        super().append(session, spoiled, done, revisions, episodes)


def _spoiled(stored: StoredStep) -> StoredStep:
    event = msgspec.structs.replace(stored.step.event, call=2**63)
    return msgspec.structs.replace(stored, step=msgspec.structs.replace(stored.step, event=event))


@pytest.fixture
async def history(tmp_path: Path) -> AsyncIterator[Choosy]:
    made = Choosy(tmp_path)
    yield made
    await asyncio.to_thread(made.close)


@pytest.fixture
async def sessions(history: Choosy, tmp_path: Path) -> AsyncIterator[Registry]:
    async with asyncio.timeout(PATIENCE):
        yield registry(history, tmp_path, GUARD)


async def joined(sessions: Registry, name: str) -> tuple[LiveSession, Monitor, Kept]:
    outbox = Kept()
    return *await sessions.attach(attach(name, "guard"), outbox), outbox


def acked(outbox: Kept) -> int:
    return max((frame["upto"] for frame in outbox.frames if frame["type"] == "ack"), default=0)


async def say(sessions: Registry, live: LiveSession, monitor: Monitor, seq: int, speed: int) -> None:
    live.ingest(monitor, event(seq, ask=True, speed=speed))
    live.ledger.write()
    await sessions.flush()
    await asyncio.sleep(0)


async def test_only_the_session_whose_row_it_is_is_judged_no_more(sessions: Registry) -> None:
    talks = [await joined(sessions, name) for name in ("one", "two", "three")]
    for seq in range(1, 5):
        for i, (live, monitor, _) in enumerate(talks):
            live.ingest(monitor, event(seq, ask=True, speed=BAD if (i, seq) == (1, 3) else 1))
            live.ledger.write()
        await sessions.flush()
        await asyncio.sleep(0)
    assert [acked(outbox) for _, _, outbox in talks] == [4, 2, 4]
    assert [live.keeping.trouble is None for live, _, _ in talks] == [True, False, True]
    decisions = [[f["decision"] for f in outbox.frames if f["type"] == "decision"] for _, _, outbox in talks]
    assert decisions[0] == decisions[2] == ["allow"] * 4
    assert decisions[1] == ["allow", "allow", "deny", "deny"], "13 is too fast, and what is not kept is not allowed"
    state = await sessions.state("two")
    assert state is not None
    assert state["status"] == "open"
    assert state["trouble"].startswith("nothing more of it can be kept: ")
    assert [s["trouble"] is None for s in await sessions.states()] == [True, False, True]


async def test_who_attaches_to_it_is_told(sessions: Registry) -> None:
    live, monitor, _ = await joined(sessions, "one")
    await say(sessions, live, monitor, 1, BAD)
    with pytest.raises(WireError, match=r"'one' can't be kept any more: .*; close it, and open another") as refused:
        await sessions.attach(attach("one", "guard", monitor="n"), Kept())
    assert (refused.value.code, refused.value.fatal) == ("history_unavailable", True)


async def test_it_is_closed_as_it_was_kept(sessions: Registry, history: Choosy) -> None:
    live, monitor, outbox = await joined(sessions, "one")
    for seq, speed in ((1, 1), (2, BAD), (3, 1)):
        await say(sessions, live, monitor, seq, speed)
    assert await sessions.closed_within(live, PATIENCE)
    (error,) = await outbox.expect("error")
    assert error["code"] == "session_closed"
    state = await sessions.state("one")
    assert state is not None
    assert state["status"] == "closed"
    assert "nothing more of it can be kept" in state["trouble"]
    assert await history.extent(live.number) == (1, 1)


async def test_a_restart_goes_on_where_it_was_kept(sessions: Registry, history: Choosy, tmp_path: Path) -> None:
    live, monitor, _ = await joined(sessions, "one")
    for seq, speed in ((1, 1), (2, BAD), (3, 1)):
        await say(sessions, live, monitor, seq, speed)
    await sessions.shut_down()
    await asyncio.to_thread(history.close)
    again = SqliteHistory(tmp_path)
    again.start(asyncio.get_running_loop())
    second = Registry(again, Library(None, tmp_path), Clock(), resume_within=10.0)
    await second.restore_all()
    live, monitor, outbox = await joined(second, "one")
    assert live.keeping.trouble is None
    assert monitor.numbering.next == 2
    for seq in (2, 3):
        await say(second, live, monitor, seq, 1)
    assert acked(outbox) == 3
    await asyncio.to_thread(again.close)


async def test_what_it_holds_in_memory_is_bounded(sessions: Registry, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(keeping_module, "_MOST_UNKEPT", 5)
    live, monitor, _ = await joined(sessions, "one")
    other, other_monitor, outbox = await joined(sessions, "two")
    rooms = []
    for seq in range(1, 10):
        await say(sessions, live, monitor, seq, BAD if seq == 2 else 1)
        rooms.append(live.keeping.has_room)
    assert rooms == [True] * 6 + [False] * 3
    waiting = asyncio.ensure_future(live.keeping.room())
    for seq in range(1, 10):
        await say(sessions, other, other_monitor, seq, 1)
    assert (other.keeping.has_room, acked(outbox)) == (True, 9)
    assert not waiting.done()
    assert await sessions.closed_within(live, PATIENCE)
    await waiting


async def test_a_session_that_can_not_be_kept_from_the_start_is_told(
    sessions: Registry, history: Choosy, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = history.open_session
    spoil: dict[str, Any] = {"opened": 2**63}

    def open_spoiled(record: SessionRecord) -> None:
        opened(record._replace(**spoil))

    monkeypatch.setattr(history, "open_session", open_spoiled)
    live = await sessions.create("guard", "one")
    await sessions.flush()
    with pytest.raises(WireError, match="can't be kept any more"):
        live.keeping.check()
    spoil.clear()
    live = await sessions.create("guard", "two")
    await sessions.flush()
    live.keeping.check()


async def test_a_state_that_can_not_be_kept_closes_nothing(sessions: Registry, monkeypatch: pytest.MonkeyPatch) -> None:
    live, monitor, outbox = await joined(sessions, "one")
    with monkeypatch.context() as broken:
        broken.setattr("oracle_server.sessions.registry.session_state", lambda *_: {"id": "\ud800"})
        with pytest.raises(Exception, match="could not be closed, and stays open"):
            await sessions.closed_within(live, PATIENCE)
    assert live.keeping.trouble is None
    await say(sessions, live, monitor, 1, 1)
    assert acked(outbox) == 1
    assert await sessions.closed_within(live, PATIENCE)


async def test_a_step_of_which_no_row_can_be_made_ends_its_session_alone(
    sessions: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    def make(position: int, gap: int, item: Judged, handling: tuple[bool, str] | None) -> StoredStep:
        if item.step.signals.get("speed") == BAD:
            raise AssertionError("no row can be made of it")
        return stored(position, gap, item, handling)

    monkeypatch.setattr(ledger_module, "stored", make)
    talks = [await joined(sessions, name) for name in ("one", "two")]
    for seq, speed in ((1, 1), (2, BAD), (3, 1)):
        for i, (live, monitor, _) in enumerate(talks):
            await say(sessions, live, monitor, seq, speed if i else 1)
    assert [acked(outbox) for _, _, outbox in talks] == [3, 1]
    assert talks[0][0].keeping.trouble is None
    assert talks[1][0].keeping.trouble == "AssertionError: no row can be made of it"
