"""Episodes in a history: those of its records, on either backend, in any order, with restarts anywhere."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Iterable
from pathlib import Path

import pytest

from oracle_server.core.episode import EpisodeRecord
from oracle_server.core.events import Order
from oracle_server.core.records import VerdictRecord
from oracle_server.core.verdicts import Outcome
from oracle_server.history.episodes import EpisodeQuery
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.port import History
from oracle_server.history.query import Query
from oracle_server.process.clock import Clock
from oracle_server.sessions.registry import Registry
from oracle_server.specfiles.library import Library
from oracle_server.wire.incoming import EPISODES
from tests.episodes import Line, expected
from tests.history.backends import BACKENDS, Make
from tests.history.making import find
from tests.processes import PATIENCE
from tests.sessions.making import Kept, attach, event, registry

SPEC = """
id: spec
ordering: {by: BY, late: LATE}
episodes: {gap: 3s}
streams:
  - topic: /a
    signals: {v: 'msg.v > 8 ? 1/(msg.v - 9) : msg.v'}
properties:
  - id: small
    formula: 'not {v > 5}'
  - id: rising
    formula: '{v > 2} since[:3] {v < 3}'
"""
START, SECOND = 1_700_000_000 * 10**9, 10**9
NAMES = ("small", "rising")


class Served:
    """A history, and the server that has it at present."""

    def __init__(self, history: History, folder: Path, text: str) -> None:
        self.history = history
        self.history.start(asyncio.get_running_loop())
        self.library = Library(None, folder)
        self.library.put("spec", text)

    async def begin(self) -> None:
        """Let a server that ended without a word be followed by another."""
        self.sessions = Registry(self.history, self.library, Clock(), resume_within=3600)
        await self.sessions.restore_all()
        self.live, self.monitor = await self.sessions.attach(attach("s", "spec"), Kept())

    async def kill(self) -> None:
        """Let nothing be kept that the server does from now on."""
        self.live.ledger._history = self.live._history = MemoryHistory()
        await self.history.flush()

    async def commit(self) -> None:
        self.live.ledger.write()
        await self.history.flush()

    async def episodes(self) -> list[EpisodeRecord]:
        page, after = await self.history.episodes(EpisodeQuery(session=1, limit=1000))
        assert after is None
        return page


async def all_records(history: History) -> list[VerdictRecord]:
    known = await history.session(1)
    assert known is not None
    found, after = [], 0
    while True:
        page, more = await find(history, known, Query(after=after, limit=1000))
        found += page
        if more is None:
            return found
        after = more


def lines(records: Iterable[VerdictRecord], *, by_place: bool) -> list[Line]:
    order = sorted(records, key=lambda record: record["stamp"]) if by_place else records
    made, latest = [], 0
    for record in order:
        latest = max(latest, record["arrived"] if record["order"] == "arrival" else record["stamp"])
        outcome = Outcome(record["outcome"] or "unknown").current
        made.append(Line(record["n"], latest, outcome, int(record["violation"]), instant=False))
    return made


@pytest.mark.parametrize(
    ("by", "late"), [("arrival", "judge"), ("publication", "judge"), ("publication", "revise"), ("both", "judge")]
)
@pytest.mark.parametrize("backend", BACKENDS)
async def test_a_history_has_the_episodes_of_its_records(
    tmp_path: Path, make: Make, backend: str, by: str, late: str
) -> None:
    found = 0
    for seed in range(5):
        rng = random.Random(f"{by} {late} {seed}")
        folder = tmp_path / str(seed)
        folder.mkdir()
        history = make(backend)
        served = Served(
            history,
            folder / "specs",
            SPEC.replace("BY", by).replace("LATE", late + ", horizon: 60s" * (late == "revise")),
        )
        await served.begin()
        time = START
        for seq in range(1, 40):
            time += rng.randint(1, 4) * SECOND // 2 + seq
            late_by = rng.choice((0, 0, 0, 2)) * SECOND
            value = rng.choice((1, 1, 4, 4, 7, 9))
            message = event(seq, "/a", v=value).model_copy(update={"stamp": time - late_by})
            served.live.ingest(served.monitor, message)
            if rng.random() < 0.2:
                await served.commit()
                await check(served, by, late, closed=False)
            if rng.random() < 0.1:
                await served.commit()
                if rng.random() < 0.5:
                    served.live.ledger.save()
                    await served.history.flush()
                await served.kill()
                await served.begin()
        async with asyncio.timeout(PATIENCE):
            await served.sessions.closed_within(served.live, PATIENCE)
        found += await check(served, by, late, closed=True)
        assert not any(episode["open"] for episode in await served.episodes())
        await asyncio.to_thread(history.close)
    assert found > 8


async def check(served: Served, by: str, late: str, *, closed: bool) -> int:
    """Compare what the history has of episodes with what its records give; returns how many there are."""
    records, have = await all_records(served.history), await served.episodes()
    while await all_records(served.history) != records:  # a late event was put in its place meanwhile
        records, have = await all_records(served.history), await served.episodes()
    orders: tuple[Order, ...] = ("publication", "arrival") if by == "both" else (by,)  # type: ignore[assignment]
    wanted = []
    for order in orders:
        for name in NAMES:
            own = [r for r in records if r["property"] == name and r["order"] == order]
            for e in expected(lines(own, by_place=late == "revise"), 3 * SECOND):
                is_open = e.open and not closed
                ends = (None, None) if is_open else (e.last, e.until)
                wanted.append((e.began, name, e.first, order, *ends, is_open, e.count))
    keys = ("began", "property", "first", "order", "last", "until", "open", "count")
    assert sorted(tuple(e[key] for key in keys) for e in have) == sorted(wanted)  # type: ignore[literal-required]
    for episode in have:
        (first,) = [r for r in records if r["n"] == episode["first"]]
        assert first["explanation"] is not None
        assert first["violation"]
        if late != "revise":  # what stands since may be explained otherwise
            assert episode["explanation"] == first["explanation"]["text"]
    return len(have)


async def test_what_an_older_version_saved_goes_on_with_the_episodes_of_the_history(tmp_path: Path) -> None:
    """Its snapshots have none; the history has made them of its rows."""
    history = MemoryHistory()
    served = Served(history, tmp_path, SPEC.replace("BY", "arrival").replace("LATE", "judge"))
    await served.begin()
    served.live.ingest(served.monitor, event(1, "/a", v=7))
    served.live.ledger.save()
    await history.flush()
    await served.kill()
    saved = await history.snapshot(1)
    assert saved is not None
    del saved.data["judges"]["arrival"]["episodes"]
    await served.begin()
    served.live.ingest(served.monitor, event(2, "/a", v=1))
    await served.commit()
    assert [(e["property"], e["first"], e["open"]) for e in await served.episodes() if e["property"] == "small"] == [
        ("small", 1, False)
    ]
    await asyncio.to_thread(history.close)


@pytest.mark.parametrize("backend", BACKENDS)
async def test_episodes_that_may_go_on_end_with_their_session_for_all_who_are_told_of_them(
    tmp_path: Path, make: Make, backend: str
) -> None:
    """Before the connection ends: monitors, and those who follow what was committed."""
    history = make(backend)
    sessions = registry(history, tmp_path / "specs", SPEC.replace("BY", "arrival").replace("LATE", "judge"))
    outbox, older = Kept(), Kept()
    wanted = attach("s", "spec").model_copy(update={"features": [EPISODES], "verdicts": True})
    live, monitor = await sessions.attach(wanted, outbox)
    await sessions.attach(attach("s", "spec", "older", "j"), older)
    live.ingest(monitor, event(1, "/a", v=7))
    await outbox.expect("episode")
    async with asyncio.timeout(PATIENCE):
        assert await sessions.closed_within(live, PATIENCE)
    told = [frame for frame in outbox.frames if frame["type"] == "episode"]
    assert [(e["event"], e["property"], e["open"], e["last"]) for e in told] == [
        ("begun", "small", True, None), ("begun", "rising", True, None),
        ("ended", "small", False, 1), ("ended", "rising", False, 2),
    ]  # fmt: skip
    standing = [frame for frame in outbox.frames if frame["type"] == "verdicts"][-1]
    assert standing["properties"]["small"]["episode"]["open"] is False
    assert outbox.frames[-1]["type"] == "error"
    assert live.ledger.episodes.since(2) == told[2:]
    assert "episode" not in {frame["type"] for frame in older.frames}
    await asyncio.to_thread(history.close)
