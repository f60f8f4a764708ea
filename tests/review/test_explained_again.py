"""What is asked for later is what was said: a session judged again explains its violations in the same words.

    CASES=1000 pytest tests/review/test_explained_again.py

is the long run. A case is told by its number alone.
"""

from __future__ import annotations

import asyncio
import os
import random

import pytest

from oracle_server.core.plan import Plan, plan
from oracle_server.core.verdicts import explained
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.records import SessionRecord, stored
from oracle_server.review import explanation
from oracle_server.review.again import plan_of
from tests.core.everything.cases import case
from tests.core.everything.running import Run
from tests.engines.test_against_brute import SEED

CASES = int(os.environ.get("CASES", "40"))
FOUND = (119,)
"""Cases that earlier versions got wrong: a session that ended after deadlines which are in no row."""


async def test_a_violation_is_explained_later_as_it_was_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = 0
    for number in (*FOUND, *range(SEED, SEED + CASES)):
        rng = random.Random(f"everything {number}")
        made = case(rng)
        run, ready = Run(made, rng), plan(made.spec)
        run.go()

        def of_the_case(_: SessionRecord, ready: Plan = ready) -> Plan:
            return ready

        monkeypatch.setattr(explanation, "plan_of", of_the_case)
        names = tuple(p.id for p in made.spec.properties)
        history = MemoryHistory()
        history.start(asyncio.get_running_loop())
        history.open_session(SessionRecord(1, "s", "s", "", "", names, False, 0)._replace(begun=run._session.begun))
        kept = [stored(position, 0, row) for position, row in enumerate(run.rows, 1)]
        history.append(1, kept, lambda: None, [])
        await history.flush()
        for step in kept:
            for index, told in step.explanations.items():
                n = (step.position - 1) * len(names) + index + 1
                record = await explanation.explained(history, 1, n)
                assert record is not None
                expected = explained(record, told)
                assert record == expected, f"case {number}, verdict {n}"
                asked += 1
    assert asked


def test_a_spec_is_read_once_for_all_that_is_asked_of_a_session() -> None:
    text = "id: s\nstreams: [{topic: /a, signals: {v: msg.v}}]\nproperties: [{id: p, formula: '{v > 1}'}]\n"
    record = SessionRecord(1, "read once", "s", text, "", ("p",), False, 0)
    assert plan_of(record) is plan_of(record)
    assert plan_of(record._replace(by="arrival")).spec.ordering.by == "arrival"
    assert plan_of(record).spec.ordering.by == "publication"
