"""The events around a moment, as they stand."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator

from oracle_server.history.memory import MemoryHistory
from oracle_server.history.records import StoredStep
from oracle_server.review.sequence import Wanted, sequence
from tests.history.making import add, opened, step
from tests.history.test_standing import revised

SPEC = """
id: spec
ordering: {late: revise, horizon: 1s}
streams: [{topic: /a, signals: {v: msg.v}}]
properties: [{id: p, formula: 'not {v: 1}'}, {id: q, formula: 'not {v: 2}'}]
"""


async def test_a_deadline_that_does_not_stand_is_none_of_them() -> None:
    history = MemoryHistory()
    history.start(asyncio.get_running_loop())
    steps = await revised(history)
    assert steps[2].is_tick
    assert steps[2].explanations, "it violated when it was said"
    for name in (None, "p", "q"):
        found = await sequence(history, opened()._replace(text=SPEC), Wanted(property=name))
        assert [item["kind"] for item in found["items"]] == ["topic"] * 4
        assert [item["n"] for item in found["items"] if item["violated"]] == ([3] if name == "p" else [4])
    history.close()


class Counted(MemoryHistory):
    """A history that notes how many rows are read at once."""

    def __init__(self) -> None:
        super().__init__()
        self.sizes: list[int] = []

    async def steps(self, session: int, after: int, upto: int | None = None) -> AsyncGenerator[list[StoredStep], None]:
        """The steps behind a position."""
        assert upto is not None
        self.sizes.append(upto - after)
        async for page in super().steps(session, after, upto):
            yield page


async def test_no_more_is_read_than_there_is_need_for() -> None:
    history = Counted()
    history.start(asyncio.get_running_loop())
    record = opened()._replace(text=SPEC.replace("late: revise, horizon: 1s", "by: publication"))
    history.open_session(record)
    await add(history, *(step(i, stream="/a" if i % 10 == 0 else "/b") for i in range(1, 1_501)))
    await sequence(history, record._replace(text="no spec that can be read"), Wanted())
    assert history.sizes == [50], "the last 40 events, and not the spec, which may take seconds"
    history.sizes.clear()
    found = await sequence(history, record, Wanted(n=3_000, property="p", limit=60))
    assert [item["stamp"] for item in found["items"]] == [10 * i for i in range(910, 1_501, 10)]
    assert found["left_out"] == 9 * 59
    assert history.sizes == [1, 50, 100, 200, 400]
    history.close()
