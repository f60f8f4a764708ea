"""Rows that come late: what stands is what judging them in the order of publication gives, as for any other step."""

from __future__ import annotations

import os
import random
from collections.abc import Iterable
from dataclasses import dataclass, replace

import msgspec
import pytest

from oracle_server.core.formula.parse import Time
from oracle_server.core.revisions import Revision
from oracle_server.core.verdicts import Judged
from tests.core.revising import B, Case, Run, case, compared, reference
from tests.engines.test_against_brute import SEED
from tests.generate import KEYS

CASES = int(os.environ.get("CASES", "125"))


def with_rows(plain: Case, rng: random.Random) -> Case:
    """The same, where what one stream tells is a list with some of what all have."""
    signals = {key: f"item.{key}" for key in KEYS}
    streams = tuple(
        replace(stream, each="msg.rows", signals=signals) if stream.key == B else stream
        for stream in plain.spec.streams
    )
    data = [event.data for event in plain.events]
    events = [
        msgspec.structs.replace(event, data={"rows": rng.sample(data, min(len(data), rng.randrange(4)))})
        if event.stream == B
        else event
        for event in plain.events
    ]
    return Case(replace(plain.spec, streams=streams), events)


@dataclass
class Whole(Run):
    """A run of which nothing is said between the rows of an event: a history keeps what is said up to the last row."""

    open: tuple[str, int, int] | None = None

    def take(self, judged: Iterable[Judged]) -> None:
        said = list(judged)
        super().take(said)
        for row in said:
            event = row.step.event
            if self.open is not None:
                assert not isinstance(row, Revision)
                assert (event.monitor, event.seq, event.row) == self.open
            self.open = (event.monitor, event.seq, (event.row or 0) + 1) if event.more else None


@pytest.mark.parametrize("restarts", [0, 0.15])
@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_what_stands_is_what_the_order_of_publication_gives(time: Time, restarts: float) -> None:
    revised = rows = 0
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"rows revised {time} {number}")
        # where it is divided, a restart would find a part of an event's rows, which no history has
        run = Whole(with_rows(case(rng, time), rng), divided=not restarts and rng.random() < 0.5, restarts=restarts)
        run.judge(rng)
        told = f"case {number}, {time}: " + "; ".join(p.text for p in run.case.spec.properties)
        assert compared(run.stands()) == compared(reference(run)), told
        for because in (revision.because for revision in run.book.revisions):
            assert len({(e.monitor, e.stream, e.seq) for e in because}) == len(because)
        revised += len(run.book.revisions)
        rows += sum(bool(row.step.event.row) for row in run.book.first.values())
    assert revised > CASES / 10
    assert rows > CASES
