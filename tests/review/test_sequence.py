"""The events around a moment, as they stand."""

from __future__ import annotations

import asyncio

from oracle_server.history.memory import MemoryHistory
from oracle_server.review.sequence import Wanted, sequence
from tests.history.making import opened
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
