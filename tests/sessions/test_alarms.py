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


def test_degraded_verdicts_less_than_a_gap_apart_are_told_once_of_each_property() -> None:
    degraded = Degraded(SECOND)
    stamps = (0, SECOND - 1, 2 * SECOND - 2, 3 * SECOND - 2, 3 * SECOND - 1)
    assert [degraded.begins("p", stamp) for stamp in stamps] == [True, False, False, True, False]
    assert degraded.begins("q", 1)
    assert not degraded.begins("p", 0), "one that was late"
    assert not degraded.begins("p", 4 * SECOND - 2), "the gap is from the latest"


class Receiver:
    """Keeps the alarms that it wants: violations."""

    def __init__(self) -> None:
        self.alarms: list[dict[str, Any]] = []

    def wants(self, what: str) -> bool:
        return what == "violation"

    def send(self, alarm: dict[str, Any]) -> None:
        if alarm["alarm"] == "violation":
            self.alarms.append(alarm)


class Alarming(Served):
    """A served history whose alarms are kept."""

    receiver: Receiver

    async def begin(self) -> None:
        self.sessions = Registry(self.history, self.library, Clock(), resume_within=3600, alarms=self.receiver)
        await self.sessions.restore_all()
        self.live, self.monitor = await self.sessions.attach(attach("s", "spec"), Kept())


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
