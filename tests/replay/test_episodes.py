"""A session's episodes are the same live, over restarts, and where its trace is judged again."""

from __future__ import annotations

import asyncio
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from oracle_server.core.episode import EpisodeRecord
from oracle_server.history.episodes import EpisodeQuery, told
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.query import Query
from oracle_server.process.clock import Clock
from oracle_server.replay.opening import open_recording
from oracle_server.replay.run import Replay
from oracle_server.review.trace import trace_lines
from oracle_server.sessions.registry import Registry
from oracle_server.specfiles.library import Library
from oracle_server.wire.incoming import ClockMessage, ClockStamp
from tests.history.making import find
from tests.processes import PATIENCE
from tests.sessions.making import Kept, attach, event

SPEC = """
id: spec
ordering: {by: publication, late: LATE}
episodes: {gap: 3s}
streams:
  - topic: /a
    signals: {v: msg.v}
properties:
  - id: small
    formula: 'not {v > 5}'
  - id: rising
    formula: '{v > 2} since[:3] {v < 3}'
"""
HALF = 500_000_000
START = {"wall": 1_700_000_000 * 10**9, "sim": 10**9}
Happens = tuple[int, int, int, bool]
"""Half seconds since the event before, the value, half seconds by which it is late, whether the server is killed."""


class Live:
    """A session of a registry that is followed by another where it is killed."""

    def __init__(self, folder: Path, late: str, clock: str) -> None:
        self.library, self.clock = Library(None, folder), clock
        self.library.put("spec", SPEC.replace("LATE", late))
        self.history = MemoryHistory()
        self.history.start(asyncio.get_running_loop())

    async def begin(self) -> None:
        self.registry = Registry(self.history, self.library, Clock(), resume_within=3600)
        await self.registry.restore_all()
        wanted = attach("s", "spec").model_copy(update={"clock": self.clock})
        self.live, self.monitor = await self.registry.attach(wanted, Kept())

    async def kill(self) -> None:
        self.live.ledger.write()
        await self.history.flush()
        self.live.ledger._history = self.live._history = MemoryHistory()
        await self.begin()

    async def run(self, happens: list[Happens]) -> None:
        await self.begin()
        time = START[self.clock]
        for seq, (later, value, late_by, killed) in enumerate(happens, 1):
            time += later * HALF + 1
            if self.clock == "sim":
                stamp = ClockStamp(stream="/a", stamp=max(1, time - 4 * HALF))
                self.live.update_clocks(self.monitor, ClockMessage(type="clock", stamps=[stamp]))
            message = event(seq, "/a", v=value).model_copy(update={"stamp": max(1, time - late_by * HALF)})
            self.live.ingest(self.monitor, message)
            if killed:
                await self.kill()
        async with asyncio.timeout(PATIENCE):
            await self.registry.closed_within(self.live, PATIENCE)

    async def episodes(self) -> list[EpisodeRecord]:
        return (await self.history.episodes(EpisodeQuery(session=1, limit=1000)))[0]

    async def violations(self) -> Counter[str]:
        known = await self.history.session(1)
        assert known is not None
        page, more = await find(self.history, known, Query(violations=True, limit=1000))
        assert more is None
        return Counter(record["property"] for record in page)

    async def write(self, path: Path) -> None:
        lines = [msgspec.json.encode(line) async for page in trace_lines(self.history, 1) for line in page]
        path.write_bytes(b"".join(line + b"\n" for line in lines))


def plain(episode: EpisodeRecord) -> tuple[object, ...]:
    return tuple(episode[key] for key in ("property", "first", "began", "count"))


@settings(max_examples=30, deadline=None, phases=[Phase.generate])
@given(
    happens=st.lists(
        st.tuples(
            st.integers(1, 4),
            st.sampled_from((1, 1, 4, 4, 7)),
            st.sampled_from((0, 0, 0, 3)),
            st.integers(0, 9).map(lambda i: i == 9),
        ),
        min_size=1,
        max_size=40,
    ),
    late=st.sampled_from(("judge", "revise, horizon: 60s")),
    clock=st.sampled_from(("wall", "sim")),
)
def test_episodes_are_the_same_live_after_restarts_and_replayed(happens: list[Happens], late: str, clock: str) -> None:
    async def judge() -> None:
        with TemporaryDirectory() as folder:
            live = Live(Path(folder), late, clock)
            await live.run(happens)
            have = await live.episodes()
            sums: Counter[str] = Counter()
            for episode in have:
                sums[episode["property"]] += episode["count"]
            assert sums == await live.violations()
            path = Path(folder) / "trace.jsonl"
            await live.write(path)
            spec = live.live.spec
            replay = Replay(spec, open_recording(path, spec))
            assert sum(1 for _ in replay) > 0
            again = [told("s", "spec", stored) for stored in replay.episodes.all()]
            assert sorted(map(plain, again)) == sorted(map(plain, have))

    asyncio.run(judge())
