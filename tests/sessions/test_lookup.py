"""An event that is sent again is answered from the history, and nothing else waits for that."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from structlog.testing import capture_logs

from oracle_server.core.errors import HistoryError, UnansweredError
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.records import StoredStep
from oracle_server.sessions import lookup
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.monitor import Monitor
from oracle_server.sessions.registry import Registry
from tests.sessions.making import GUARD, Kept, attach, event, registry


class Stuck(MemoryHistory):
    """A history whose answers come when they are let go."""

    def __init__(self) -> None:
        super().__init__()
        self.going = asyncio.Event()
        self.asked = 0

    async def asked_step(self, session: int, monitor: str, seq: int) -> StoredStep | None:
        self.asked += 1
        await self.going.wait()
        return await super().asked_step(session, monitor, seq)


async def begun(history: MemoryHistory, folder: Path) -> tuple[Registry, LiveSession, Monitor, Kept]:
    """A session with a monitor, one of whose events is decided and acked, and what that was sent."""
    sessions, outbox = registry(history, folder, GUARD), Kept()
    live, monitor = await sessions.attach(attach("s", "guard"), outbox)
    live.ingest(monitor, event(1, ask=True, speed=9))
    await outbox.expect("ack")
    return sessions, live, monitor, outbox


async def test_nothing_waits_for_an_answer_that_the_history_has(tmp_path: Path) -> None:
    history = Stuck()
    sessions = registry(history, tmp_path, GUARD)
    first = Kept()
    live, monitor = await sessions.attach(attach("s", "guard"), first)
    live.ingest(monitor, event(1, ask=True, speed=9))
    (denied,) = await first.expect("decision")
    assert denied["decision"] == "deny"
    await first.expect("ack")
    second = Kept()
    live, monitor = await sessions.attach(attach("s", "guard"), second)
    live.ingest(monitor, event(1, ask=True, speed=9))
    live.ingest(monitor, event(2, ask=True, speed=1))
    (allowed,) = await second.expect("decision")
    assert (allowed["seq"], allowed["decision"]) == (2, "allow")
    history.going.set()
    _, again = await second.expect("decision", 2)
    assert again == denied
    assert (await second.expect("ack"))[-1]["upto"] >= 1
    live.ledger.write()
    await history.flush()
    acks = len(await second.expect("ack"))
    live.ingest(monitor, event(1, ask=True, speed=9))
    await second.expect("decision", 3)
    assert len(await second.expect("ack", acks + 1)) == acks + 1, "what was sent again alone is acked again"


async def test_what_is_sent_again_before_it_is_kept_has_its_answer_at_once(tmp_path: Path) -> None:
    history = Stuck()
    sessions, outbox = registry(history, tmp_path, GUARD), Kept()
    live, monitor = await sessions.attach(attach("s", "guard"), outbox)
    for _ in range(2):
        live.ingest(monitor, event(1, ask=True, speed=9))
    decided, again = [frame for frame in outbox.frames if frame["type"] == "decision"]
    assert decided["decision"] == "deny"
    assert again == decided
    assert history.asked == 0


async def test_what_waits_for_answers_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lookup, "_MOST", 10)
    history = Stuck()
    sessions = registry(history, tmp_path, GUARD)
    outbox = Kept()
    live, monitor = await sessions.attach(attach("s", "guard"), outbox)
    for seq in range(1, 31):
        live.ingest(monitor, event(seq, ask=True, speed=seq))
    await outbox.expect("decision", 30)
    await history.flush()
    live.ledger.write()
    await history.flush()
    for seq in range(1, 31):
        live.ingest(monitor, event(seq, ask=True, speed=seq))
    assert not live.keeping.has_room, "its monitors are not read meanwhile"
    async with asyncio.timeout(10):
        while not history.asked:
            await asyncio.sleep(0)
    assert not live.keeping.has_room, "one that is taken makes room for none"
    history.going.set()
    async with asyncio.timeout(10):
        await live.keeping.room()
    found = await outbox.expect("decision", 60)
    assert found[30:] == found[:30]


async def test_a_connection_that_is_gone_is_answered_nothing(tmp_path: Path) -> None:
    history = Stuck()
    sessions, live, monitor, first = await begun(history, tmp_path)
    live.ingest(monitor, event(1, ask=True, speed=9))
    live.ingest(monitor, event(1, ask=True, speed=9))
    await asyncio.sleep(0)
    live.disconnected(monitor, first)
    second = Kept()
    await sessions.attach(attach("s", "guard"), second)
    history.going.set()
    live.ingest(monitor, event(1, ask=True, speed=9))
    await second.expect("decision")
    assert len(await first.expect("decision")) <= 2
    assert len(await second.expect("decision")) == 1


async def test_a_history_that_can_not_be_read_ends_no_session(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    history = MemoryHistory()
    _, live, monitor, outbox = await begun(history, tmp_path)

    failed = asyncio.Event()

    async def fails(*_: object) -> None:
        failed.set()
        raise HistoryError("the history can't be read: disk I/O error")

    monkeypatch.setattr(history, "asked_step", fails)
    live.ingest(monitor, event(1, ask=True, speed=9))
    live.ingest(monitor, event(2, ask=True, speed=1))
    assert [frame["seq"] for frame in await outbox.expect("decision", 2)] == [1, 2]
    await failed.wait()
    monkeypatch.undo()
    live.ingest(monitor, event(1, ask=True, speed=9))
    assert [frame["seq"] for frame in await outbox.expect("decision", 3)] == [1, 2, 1]
    assert "disk I/O error" in capsys.readouterr().out


async def test_a_database_that_does_not_answer_is_asked_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else a monitor whose connection lasts is told nothing, though its event was decided, and is there."""
    monkeypatch.setattr(lookup, "_AGAIN", 0)
    history = MemoryHistory()
    _, live, monitor, outbox = await begun(history, tmp_path)
    good, tries, gone, never = history.asked_step, 0, asyncio.Event(), asyncio.Event()

    async def fails(session: int, name: str, seq: int) -> StoredStep | None:
        nonlocal tries
        tries += 1
        gone.set()
        if tries < 4 or never.is_set():
            raise UnansweredError("PostgreSQL: the connection is closed")
        return await good(session, name, seq)

    monkeypatch.setattr(history, "asked_step", fails)
    with capture_logs() as told:
        live.ingest(monitor, event(1, ask=True, speed=9))
        first, again = await outbox.expect("decision", 2)
        assert first == again
    assert [line["seq"] for line in told if line["log_level"] == "warning"] == [1]
    assert tries == 4
    never.set()
    gone.clear()
    live.ingest(monitor, event(1, ask=True, speed=9))
    await gone.wait()
    live.disconnected(monitor, outbox)
    async with asyncio.timeout(10):
        while monitor.unsettled:
            await asyncio.sleep(0)
    assert len(await outbox.expect("decision")) == 2, "nobody waits for it any more"


async def test_no_failure_leaves_an_event_waiting_or_a_session_unread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A row that can't be understood, say: the events behind it are answered, and there is room again."""
    monkeypatch.setattr(lookup, "_MOST", 1)
    history = MemoryHistory()
    sessions = registry(history, tmp_path, GUARD)
    outbox = Kept()
    live, monitor = await sessions.attach(attach("s", "guard"), outbox)
    for seq in (1, 2, 3):
        live.ingest(monitor, event(seq, ask=True, speed=9))
    await outbox.expect("decision", 3)
    live.ledger.write()
    await history.flush()
    good = history.asked_step

    async def fails(session: int, name: str, seq: int) -> StoredStep | None:
        if seq == 1:
            raise ValueError("no outcome 'x'")
        return await good(session, name, seq)

    monkeypatch.setattr(history, "asked_step", fails)
    for seq in (1, 2, 3):
        live.ingest(monitor, event(seq, ask=True, speed=9))
    assert not live.keeping.has_room
    assert [frame["seq"] for frame in await outbox.expect("decision", 5)] == [1, 2, 3, 2, 3]
    async with asyncio.timeout(10):
        await live.keeping.room()
    assert "no outcome 'x'" in capsys.readouterr().out


async def test_a_monitor_that_detaches_is_answered_first(tmp_path: Path) -> None:
    history = Stuck()
    sessions, live, monitor, _ = await begun(history, tmp_path)
    second = Kept()
    live, monitor = await sessions.attach(attach("s", "guard"), second)
    live.ingest(monitor, event(1, ask=True, speed=9))
    live.detach(monitor)
    history.going.set()
    await second.expect("detached")
    assert [frame["type"] for frame in second.frames if frame["type"] != "ack"] == ["decision", "detached"]
