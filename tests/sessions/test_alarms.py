"""Who is told of an episode: each once, over restarts, and where late events give it another beginning."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest

from oracle_server.history.memory import MemoryHistory
from oracle_server.process.clock import Clock
from oracle_server.sessions.alarms import Degraded
from oracle_server.sessions.registry import Registry
from tests.processes import PATIENCE
from tests.sessions.making import Kept, attach, event
from tests.sessions.test_episodes import SPEC, START, Served

SECOND = 10**9


def test_degraded_verdicts_are_told_where_they_begin_and_not_while_they_go_on() -> None:
    degraded = Degraded(SECOND)

    def begins(prop: str, seconds: float, *, is_so: bool = True) -> bool:
        return degraded.begins(prop, int(seconds * SECOND), degraded=is_so)

    assert not begins("p", 0, is_so=False)
    assert [begins("p", seconds) for seconds in (1, 1.5, 60, 3600)] == [True, False, False, False]
    assert begins("q", 1)
    assert not begins("p", 3600.1, is_so=False)
    assert not begins("p", 3600.9), "less than a gap between"
    assert not begins("p", 3500), "one that was late"
    assert not begins("p", 3601, is_so=False)
    assert begins("p", 3601.9), "a gap behind the latest"


class Receiver:
    """Keeps the alarms of the one kind that it wants."""

    def __init__(self, what: str = "violation") -> None:
        self.what = what
        self.alarms: list[dict[str, Any]] = []

    def wants(self, what: str) -> bool:
        return what == self.what

    def send(self, alarm: dict[str, Any]) -> None:
        if self.wants(alarm["alarm"]):
            self.alarms.append(alarm)


class Alarming(Served):
    """A served history whose alarms are kept."""

    receiver: Receiver

    async def begin(self) -> None:
        self.sessions = Registry(self.history, self.library, Clock(), resume_within=3600, alarms=self.receiver)
        await self.sessions.restore_all()
        self.live, self.monitor = await self.sessions.attach(attach("s", "spec"), Kept())


DOUBTFUL = """
id: spec
ordering: {by: arrival}
streams:
  - topic: /a
    signals: {v: '1.0 / msg.v'}
  - topic: /b
    signals: {w: msg.w}
properties:
  - id: small
    formula: 'not {v > 5}'
  - id: dear
    formula: 'forall[x, y]. once {v: *x} or not once {w: *y} or not {topic: /b}'
"""


async def test_it_is_told_once_why_a_property_is_degraded_and_that_one_is_not_judged_any_more(tmp_path: Path) -> None:
    served = Alarming(MemoryHistory(), tmp_path, DOUBTFUL)
    served.receiver = Receiver("degraded")
    await served.begin()
    for seq in range(1, 300):
        message = event(seq, "/a", v=1 - seq) if seq % 2 else event(seq, "/b", w=seq)
        served.live.ingest(served.monitor, message.model_copy(update={"stamp": START + 2 * SECOND * seq}))
        if seq < 4:
            await served.commit()
    await served.sessions.closed_within(served.live, PATIENCE)
    told = [(alarm["property"], alarm["text"]) for alarm in served.receiver.alarms]
    lost = "what came before was lost, skipped, not computed or judged too early"
    *others, (name, text) = told
    assert others == [(each, f"the verdicts of {each} are degraded: {lost}") for each in ("small", "dear")]
    assert name == "dear"
    assert text.startswith("dear is no longer judged: its steps cost too much")


@pytest.mark.parametrize("late", ["judge", "revise, horizon: 60s"])
async def test_each_episode_is_told_once_over_restarts_and_revisions(tmp_path: Path, late: str) -> None:
    found = moved = 0
    for seed in range(6):
        rng = random.Random(f"alarms {late} {seed}")
        folder = tmp_path / str(seed)
        folder.mkdir()
        served = Alarming(MemoryHistory(), folder, SPEC.replace("BY", "publication").replace("LATE", late))
        served.receiver = Receiver()
        await served.begin()
        time = START
        for seq in range(1, 60):
            time += rng.randint(1, 4) * SECOND // 2 + seq
            late_by = rng.choice((0, 0, 0, 2)) * SECOND
            message = event(seq, "/a", v=rng.choice((1, 1, 4, 4, 7))).model_copy(update={"stamp": time - late_by})
            served.live.ingest(served.monitor, message)
            if rng.random() < 0.3:
                await served.commit()
            if rng.random() < 0.05:
                await served.commit()
                await served.kill()
                await served.begin()
        await served.sessions.closed_within(served.live, PATIENCE)
        told = [(alarm["property"], alarm["n"]) for alarm in served.receiver.alarms]
        assert len(told) == len({*told})
        have = {(e["property"], e["first"]) for e in await served.episodes()}
        if late == "judge":
            assert {*told} == have
        found, moved = found + len(have), moved + len(have - {*told})
    assert found > 25
    assert late == "judge" or moved > 0
