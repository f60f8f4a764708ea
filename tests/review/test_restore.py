"""A session that is restored goes on as if nothing had been; what can't be judged again is judged no more."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from oracle_server.history.memory import MemoryHistory
from oracle_server.history.port import History
from oracle_server.history.query import Query
from oracle_server.history.records import Refusal, SnapshotRecord
from oracle_server.process.clock import Clock
from oracle_server.sessions.registry import Registry
from oracle_server.specfiles.library import Library
from oracle_server.wire.errors import WireError
from tests.history.making import find
from tests.processes import PATIENCE
from tests.sessions.making import Kept, attach, event

SPEC = """
id: spec
ordering: {by: BY, max_delay: none, late: skip}
streams:
  - topic: /a
    signals: {v: msg.v}
  - topic: /b
    signals: {v: msg.v}
properties:
  - id: never_big
    formula: 'historically (not {v > 8})'
  - id: b_after_a
    formula: 'forall[i]. {topic: "/b", v: *i} -> once {topic: "/a", v: *i}'
"""
TIMES = {"arrived", "judged"}


class Served:
    """A history, and the server that has it at present."""

    def __init__(
        self, folder: Path, by: str, text: str = SPEC, history: History | None = None, clock: Clock | None = None
    ) -> None:
        self.clock = clock or Clock()
        self.history = history or MemoryHistory()
        self.history.start(asyncio.get_running_loop())
        self.library = Library(None, folder)
        self.library.put("spec", text.replace("BY", by))

    async def begin(self) -> None:
        """Let a server that ended without a word be followed by another."""
        self.sessions = Registry(self.history, self.library, self.clock, resume_within=3600)
        await self.sessions.restore_all()
        self.outbox = Kept()
        self.live, self.monitor = await self.sessions.attach(attach("s", "spec"), self.outbox)

    async def send(self, seq: int, stream: str, v: int, stamp: int) -> None:
        self.live.ingest(self.monitor, event(seq, stream, v=v).model_copy(update={"stamp": stamp * 10**9}))
        await self.commit()

    async def refuse(self, seq: int) -> None:
        self.live.refuse(self.monitor, WireError("bad_event", "can't be read", seq=seq))
        await self.commit()

    async def commit(self) -> None:
        self.live.ledger.write()
        await self.history.flush()

    async def records(self) -> list[dict[str, Any]]:
        found, _ = await find(self.history, self.live.record, Query(limit=1000))
        return [{name: value for name, value in record.items() if name not in TIMES} for record in found]


async def judged(folder: Path, by: str, *, restarted: bool, saved: bool = False) -> tuple[list[dict[str, Any]], Any]:
    """What comes of some events, with a server that ends after each of them, or goes on."""
    folder.mkdir()
    made = Served(folder, by)
    await made.begin()
    sent = [
        (1, "/a", 1, 1), (2, "/b", 1, 1), (4, "/a", 2, 2), None, (6, "/a", 9, 4), (7, "/b", 2, 3), (8, "/b", 5, 5),
        (9, "/a", 5, 1), (10, "/a", 5, 6), (12, "/b", 5, 7),
    ]  # fmt: skip
    for item in sent:
        await (made.refuse(5) if item is None else made.send(*item))
        if saved:
            made.live.ledger.save()
            await made.history.flush()
        if restarted:
            await made.begin()
            for again in sent[: sent.index(item) + 1]:  # an adapter sends again what was not acked
                await (made.refuse(5) if again is None else made.send(*again))
    assert await made.sessions.closed_within(made.live, PATIENCE)
    state = await made.sessions.state("s")
    assert state is not None
    names = ["steps", "refused", "late", "skipped", *(["lost"] if by == "arrival" else [])]
    return await made.records(), [made.monitor.numbering.upto, *(state["counters"][name] for name in names)]


@pytest.mark.parametrize("saved", [False, True])
@pytest.mark.parametrize("by", ["arrival", "publication", "both"])
async def test_a_server_that_ends_after_each_event_judges_as_one_that_goes_on(
    tmp_path: Path, by: str, *, saved: bool
) -> None:
    async with asyncio.timeout(PATIENCE):
        plain = await judged(tmp_path / "plain", by, restarted=False)
        assert await judged(tmp_path / "restarted", by, restarted=True, saved=saved) == plain


async def test_a_restart_reads_no_refusal_that_the_snapshot_knows_of(tmp_path: Path) -> None:
    """A monitor whose every event is refused would else make each start longer."""
    made = Served(tmp_path, "arrival")
    await made.begin()
    for seq in range(1, 6):
        await made.refuse(seq)
    await made.send(6, "/a", 1, 6)
    made.live.ledger.save()
    await made.refuse(7)
    read: list[int] = []
    refusals = made.history.refusals

    async def counted(session: int, after: Mapping[str, int] | None = None) -> list[Refusal]:
        found = await refusals(session, after)
        read.extend(refusal.seq for refusal in found)
        return found

    made.history.refusals = counted  # type: ignore[method-assign]
    await made.begin()
    assert read == [7]
    assert made.live.ledger.refused == 6
    assert made.monitor.numbering.upto == 7


async def test_what_can_not_be_judged_again_is_judged_no_more(tmp_path: Path) -> None:
    made = Served(tmp_path, "arrival")
    await made.begin()
    for seq in range(1, 6):
        await made.send(seq, "/a", 1, seq)
    made.history.save_snapshot(1, SnapshotRecord(3, None, 3, {}))
    await made.history.forget_steps(1, 3)
    await made.begin()
    await made.send(6, "/a", 1, 6)
    assert [(r["n"], r["outcome"]) for r in await made.records()][-4:] == [
        (9, "currently_true"), (10, "currently_true"), (11, "unknown"), (12, "unknown"),
    ]  # fmt: skip
