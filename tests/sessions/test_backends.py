"""A server's sessions are the same over every backend: judged, restored, asked about, closed and pruned."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from oracle_server.core.spec import Retention
from oracle_server.history.port import History
from oracle_server.history.query import Query
from oracle_server.history.retention import Pruner
from oracle_server.process.clock import Clock
from oracle_server.review.again import NoExplanationError
from oracle_server.review.explanation import explained
from oracle_server.review.trace import trace_lines
from oracle_server.sessions.registry import Registry
from oracle_server.specfiles.library import Library
from oracle_server.wire.errors import WireError
from oracle_server.wire.incoming import Handling
from tests.history.backends import BACKENDS, Make
from tests.history.making import find
from tests.processes import PATIENCE
from tests.sessions.making import Kept, attach, event

SPEC = """
id: spec
ordering: {by: BY, max_delay: none}
streams:
  - topic: /go
    action: filter
    decide_within: 1h
    signals: {speed: msg.speed}
  - topic: /on
    signals: {mode: msg.mode}
properties:
  - id: slow
    formula: 'not {speed > 3}'
    guards: [/go]
  - id: never_fast
    formula: 'historically (not {speed > 8})'
  - id: known
    formula: 'forall[i]. {topic: "/on", mode: *i} -> not pre once {topic: "/on", mode: *i}'
"""


class Counting(Clock):
    """A clock that is the same in each run."""

    def now(self) -> int:
        self._now = max(self._now, 10**18) + 1
        return self._now


class Run:
    """What a server does with its history, and all that comes of it."""

    def __init__(self, history: History, folder: Path, by: str) -> None:
        self.history, self.clock = history, Counting()
        self.clock._now = 0
        self.library = Library(None, folder)
        self.library.put("spec", SPEC.replace("BY", by))
        self.outboxes: list[Kept] = []

    async def server(self, *seqs: int, save: bool = False) -> None:
        """Restore what is open, and have a monitor send events, the first ones again."""
        sessions = self.sessions = Registry(self.history, self.library, self.clock, resume_within=3600)
        await sessions.restore_all()
        outbox = Kept()
        self.outboxes.append(outbox)
        live, monitor = await sessions.attach(attach("s", "spec"), outbox)
        for seq in seqs:
            on = seq % 3 == 0
            made = event(seq, "/on" if on else "/go", ask=not on, speed=seq % 10, mode=seq % 4)
            live.ingest(monitor, made.model_copy(update={"stamp": 10**9 * seq}))
            live.ledger.write()
            await self.history.flush()
        try:
            live.ingest(monitor, event(seqs[-1] + 1, "/nothing"))
        except WireError as error:
            outbox.drop(error)
        live.record_handling(monitor, Handling(seq=seqs[0], passed=True, why="decision"))
        await self.history.flush()
        while live.ledger.lookup._task is not None:
            await asyncio.sleep(0.001)
        if save:
            live.ledger.save()
        await sessions.shut_down()

    async def asked(self) -> list[Any]:
        """What the history and the server say."""
        record = await self.sessions.known("s")
        assert record is not None
        records, _ = await find(self.history, record, Query(limit=1000))
        lines = [line async for page in trace_lines(self.history, record.number) for line in page]
        violated = [r["n"] for r in records if r["violation"]]
        whys = [await self._why(record.number, n) for n in violated]
        monitors, refusals = await self.history.monitors(1), await self.history.refusals(1)
        return [record, records, lines, whys, monitors, refusals, await self.history.extent(1)]

    async def _why(self, session: int, n: int) -> Any:
        try:
            return await explained(self.history, session, n)
        except NoExplanationError as error:
            return str(error)


async def run(history: History, folder: Path, by: str) -> list[Any]:
    made = Run(history, folder, by)
    await made.server(1, 2, 3, 4, 5, 6)
    await made.server(1, 2, 8, 9, 10, 12, 14, save=True)
    found: list[Any] = [await made.asked()]
    pruner = Pruner(history, Retention(events=4), made.library.retention, made.clock.ago, made.sessions.save)
    await pruner.prune()
    await made.server(2, 14, 16, 17)
    found.append([await history.extent(1), await history.monitors(1), await history.refusals(1)])
    sessions = made.sessions = Registry(history, made.library, made.clock, resume_within=3600)
    await sessions.restore_all()
    assert await sessions.closed_within(sessions.open["s"], 60)
    found += [await sessions.state("s"), await sessions.states(), await made.asked()]
    frames = [[frame for frame in outbox.frames if frame["type"] != "ack"] for outbox in made.outboxes]
    return [*found, frames, [outbox.frames[-1] for outbox in made.outboxes]]


@pytest.mark.parametrize("by", ["publication", "both"])
async def test_sessions_are_the_same_over_every_backend(tmp_path: Path, make: Make, by: str) -> None:
    found = {}
    for name in BACKENDS:
        (tmp_path / name).mkdir()
        history = make(name)
        history.start(asyncio.get_running_loop())
        async with asyncio.timeout(PATIENCE):
            found[name] = await run(history, tmp_path / name, by)
        await asyncio.to_thread(history.close)
    for told in zip(*found.values(), strict=True):
        assert all(each == told[0] for each in told), told
    answers = [frame["seq"] for frame in found["sqlite"][-2][1] if frame["type"] == "decision"]
    assert sorted(answers) == [1, 2, 8, 10, 14], "what was sent again is answered again"
    seqs = [line["seq"] for line in found["sqlite"][0][2] if line["monitor"]]
    assert seqs == [1, 2, 3, 4, 5, 6, 8, 9, 10, 12, 14], "and nothing is judged twice"
    first, _ = found["sqlite"][1][0]
    assert (first > 1) == (by == "publication"), "what a snapshot makes needless was pruned"
