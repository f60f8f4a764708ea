"""A session that goes on from a snapshot, against one that was never stopped."""

from __future__ import annotations

import json
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.session import Session
from oracle_server.core.spec import Property
from oracle_server.engines.native import NativeEngine
from tests.core.sessions import A, Feed, open_session, prop, reelay
from tests.core.test_session_again import PROPERTIES, Happening, happenings, run

TIMED = [*PROPERTIES, prop("t", "once[9ns:] {v: 1} -> once {v: 2}", time="seconds", guards=frozenset({"/a"}))]


def native(property_: Property) -> NativeEngine:
    return NativeEngine(property_.formula, property_.time)


def opened(**ordering: Any) -> Session:
    return open_session(TIMED, attach={}, maker=native, **ordering)


@settings(max_examples=150, deadline=None)
@given(
    before=happenings,
    after=happenings,
    by=st.sampled_from(("publication", "arrival")),
    late=st.sampled_from(("judge", "skip")),
)
def test_a_session_goes_on_from_its_snapshot(
    before: list[Happening], after: list[Happening], by: str, late: str
) -> None:
    ordering = {"by": by, "late": late, "capacity": 100, "max_delay": 20, "max_skew": 30}
    there, back = opened(**ordering), opened(**ordering)
    judged = run(there, before, 1_000)
    back.restore(json.loads(json.dumps(there.snapshot())), len(judged) * len(TIMED) + 1)
    assert run(back, after, there.now) == run(there, after, there.now)
    assert [j.counters for j in back.judges.values()] == [j.counters for j in there.judges.values()]


def test_there_is_no_snapshot_between_two_orders_nor_of_an_engine_that_cannot_be_saved() -> None:
    assert opened(by="both").snapshot() is None
    session = open_session([prop("p", "once {v: 1}")], attach={"m": [A]}, maker=reelay)
    assert session.snapshot() is None
    latched = open_session([prop("p", "{v: 1}", latch=True)], attach={"m": [A]}, maker=reelay, by="arrival")
    Feed(latched)(A, 1)
    assert latched.snapshot() is not None, "what is final needs no engine"
