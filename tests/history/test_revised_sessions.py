"""What a history tells of a session that revises is what the session said, whatever was written together."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import pytest

from oracle_server.core.records import VerdictRecord
from oracle_server.core.revisions import Revision
from oracle_server.core.verdicts import Judged
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.port import History
from oracle_server.history.query import Query
from oracle_server.history.records import SessionRecord, StoredStep, stored, stored_revision
from oracle_server.history.sqlite.history import SqliteHistory
from oracle_server.history.views import View
from oracle_server.replay.run import Replay
from oracle_server.replay.traces.jsonl import read_lines
from oracle_server.review.trace import trace_lines
from oracle_server.wire.json import encode_bytes
from tests.core.revising import Book, Run, case
from tests.history.making import PROPERTIES, find, opened
from tests.strategies import START

WIDTH = len(PROPERTIES)


@dataclass
class Kept(Run):
    """A run that keeps what the session said, as it came."""

    said: list[list[Judged]] = field(default_factory=list)

    def take(self, judged: Iterable[Judged]) -> None:
        self.said.append(list(judged))
        super().take(self.said[-1])


async def write(history: History, run: Kept, rng: random.Random, record: SessionRecord | None = None) -> None:
    """Write what was said as a ledger does: what came at once together, and more with it."""
    history.open_session((record or opened())._replace(begun=START))
    position, waiting = 0, list[Judged]()
    for said in run.said:
        waiting += said
        if rng.random() < 0.5 or said is run.said[-1]:
            rows = list[StoredStep]()
            for row in waiting:
                position += 1
                revised = isinstance(row, Revision)
                rows.append(stored_revision(position, row) if revised else stored(position, 0, row))  # type: ignore[arg-type]
            history.append(1, rows, lambda: None, [row for row in waiting if isinstance(row, Revision)])
            waiting = []
    await history.flush()


async def read(history: History, view: View) -> list[VerdictRecord]:
    found, after = await find(history, opened(), Query(view=view, limit=100_000))
    assert after is None
    return found


async def traced(history: History, run: Kept, rng: random.Random, folder: Path) -> None:
    """Hold what a replay of the session's trace says against what the session said."""
    history.start(asyncio.get_running_loop())
    await write(history, run, rng)
    path = folder / "trace.jsonl"
    lines = [line async for page in trace_lines(history, 1) for line in page]
    path.write_bytes(b"".join(encode_bytes(line) + b"\n" for line in lines))
    again = Book(WIDTH)
    for said in Replay(run.case.spec, read_lines(path, run.case.spec)).outputs():
        again.take(said)
    await asyncio.to_thread(history.close)
    assert {p: _said(row) for p, row in again.first.items()} == {p: _said(row) for p, row in run.book.first.items()}
    assert {p: again.stands(p) for p in again.first} == {p: run.book.stands(p) for p in run.book.first}
    assert [r.changes for r in again.revisions] == [r.changes for r in run.book.revisions]


def _said(row: Judged) -> tuple[object, ...]:
    step = row.step
    verdicts = [(v.n, v.property, v.outcome, v.degraded, v.explanation is not None) for v in row.verdicts]
    return row.number, row.place, step.event.seq, step.stamp, step.late, row.decision, verdicts


async def compare(history: History, run: Kept, rng: random.Random) -> int:
    """Hold what the history tells against what the session said; how many revisions there were."""
    history.start(asyncio.get_running_loop())
    await write(history, run, rng)
    book = run.book
    rows = [row for said in run.said for row in said]
    assert [r["n"] for r in await read(history, "first")] == [
        (position - 1) * WIDTH + i + 1 for position in sorted(book.first) for i in range(WIDTH)
    ]
    changes = [c for row in rows if isinstance(row, Revision) for c in row.changes if c is not None]
    told = [r for r in await read(history, "all") if r["kind"] == "revision"]
    assert [(r["n"], r["revises"]["from"], r["revises"]["to"], r["outcome"]) for r in told] == [
        (c.n, c.first, c.last, None if c.outcome is None else c.outcome.value) for c in changes
    ]
    wanted = []
    for position in sorted(book.first):
        stands = book.stands(position)
        for i, outcome in enumerate(stands.outcomes):
            n = (position - 1) * WIDTH + i + 1
            by = [c.n for c in changes if c.first <= n <= c.last and (c.n - n) % WIDTH == 0]
            if outcome is not None:
                wanted.append((n, outcome.value, stands.degraded[i], i in stands.explanations, max(by, default=None)))
    found = await read(history, "standing")
    assert [(r["n"], r["outcome"], r["degraded"], r["violation"], r.get("revised")) for r in found] == wanted
    violations, _ = await find(history, opened(), Query(violations=True, limit=1000))
    assert violations == [r for r in found if r["violation"]]
    await asyncio.to_thread(history.close)
    return len(changes)


@pytest.mark.parametrize("time", ["steps", "seconds"])
@pytest.mark.parametrize("backend", ["sqlite", "memory"])
def test_what_is_told_is_what_was_said(
    time: Literal["steps", "seconds"], backend: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    revisions = 0
    for seed in range(60):
        rng = random.Random(seed)
        run = Kept(case(rng, time), divided=rng.random() < 0.5)
        run.judge(rng)
        history = MemoryHistory() if backend == "memory" else SqliteHistory(tmp_path_factory.mktemp("history"))
        revisions += asyncio.run(compare(history, run, rng))
    assert revisions > 20


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_a_replay_of_its_trace_says_the_same(
    time: Literal["steps", "seconds"], tmp_path_factory: pytest.TempPathFactory
) -> None:
    revisions = 0
    for seed in range(150):
        rng = random.Random(seed)
        run = Kept(case(rng, time), divided=rng.random() < 0.3)
        run.judge(rng)
        try:
            asyncio.run(traced(MemoryHistory(), run, rng, tmp_path_factory.mktemp("trace")))
        except AssertionError as error:
            raise AssertionError(f"case {seed}") from error
        revisions += len(run.book.revisions)
    assert revisions > 20
