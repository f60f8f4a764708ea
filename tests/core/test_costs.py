"""A property that costs too much, or whose engine fails: it is unknown for good, and the others are judged on."""

from __future__ import annotations

from typing import Any

import pytest

from oracle_server.core.engine import MAX_WORK
from oracle_server.core.errors import EngineError
from oracle_server.core.session import Session
from oracle_server.core.spec import Property, StreamSpec
from oracle_server.core.verdicts import Judged, Outcome
from oracle_server.engines.native import NativeEngine
from tests.core.sessions import A, B, Feed, Recorder, degraded, open_session, outcomes, prop

SECOND = 10**9
EXPLODING = "exists[x, y, z]. ({v: *x} or {w: *y}) since ({v: *y} or {w: *z})"


def native(property_: Property) -> NativeEngine:
    return NativeEngine(property_.formula, property_.time, share=0.1)


def opened(*properties: Property, **stream: Any) -> Session:
    streams = [StreamSpec("/a", **stream), StreamSpec("/b")]
    return open_session(list(properties), attach={"m": [A, B]}, streams=streams, maker=native, by="arrival")


def told(judged: list[Judged], name: str) -> set[str]:
    return set(outcomes(judged, name))


def test_a_formula_that_explodes_is_unknown_and_the_others_are_judged_on() -> None:
    session = opened(prop("greedy", EXPLODING), prop("small", "{v > 0}"))
    feed = Feed(session)
    judged = [j for n in range(1, 500) for j in feed(A, n, {"v": n, "w": n * 3})]
    greedy, small = session.judges["arrival"].properties
    first = outcomes(judged, "greedy").index("unknown")
    assert set(outcomes(judged, "greedy")[first:]) == {"unknown"}
    assert set(degraded(judged, "greedy")[first + 1 :]) == {True}
    assert "cost too much" in (greedy.broken or "")
    assert greedy.failures == len(judged) - first
    assert not isinstance(greedy.engine, NativeEngine), "what it took is free"
    assert told(judged, "small") == {"currently_true"}
    assert not any(degraded(judged, "small"))
    assert small.broken is None
    again = opened(prop("greedy", EXPLODING), prop("small", "{v > 0}"))
    data = session.snapshot()
    assert data is not None
    again.restore(data, 1)
    assert again.judges["arrival"].properties[0].broken == greedy.broken


def test_an_engine_that_fails_at_an_attempt_judges_no_more_though_the_attempt_never_happened() -> None:
    failing = Recorder([Outcome.CURRENTLY_TRUE, EngineError("enough"), Outcome.CURRENTLY_TRUE])

    class Back(Recorder):
        def mark(self) -> None: ...
        def back(self) -> None: ...
        def keep(self) -> None: ...
        def next_deadline(self, after: int) -> int | None: ...

    engine = Back(failing.says)
    streams = [StreamSpec("/a", action="filter", on_deny="undo")]
    session = open_session(
        [prop("p", "{v: 1}", guards=frozenset({"/a"}))],
        attach={"m": [A]}, streams=streams, maker=lambda _: engine, by="arrival",
    )  # fmt: skip
    feed = Feed(session)
    judged = [j for n in range(1, 5) for j in feed(A, n, {"v": 1}, ask=True)]
    assert [j.decision.choice for j in judged if j.decision] == ["allow", "deny", "deny", "deny"]
    assert outcomes(judged) == ["currently_true", "unknown", "unknown", "unknown"]
    assert degraded(judged) == [False, False, True, True]
    assert len(engine.times) == 2, "an engine that failed is asked no more"


@pytest.mark.parametrize("count", [50, 600])
def test_deadlines_that_run_out_all_at_once_cost_no_more_than_they_may(count: int) -> None:
    """Each looks again at all that ran out before it: fifty cost little, and thousands too much."""
    text = "not exists[i]. once[5s:]{v: *i} and not once{w: *i} and pre {v: 0}"
    session = opened(prop("answered", text, time="seconds"), prop("small", "{v > 0}"))
    feed = Feed(session)
    for n in range(1, count + 1):
        feed(A, n * 1000, {"v": n})
    judged = session.advance(60 * SECOND) + feed(A, 61 * SECOND, {"v": 1})
    answered, small = session.judges["arrival"].properties
    if count == 50:
        assert answered.broken is None
        assert answered.idle_work < MAX_WORK
    else:
        assert "deadlines cost too much" in (answered.broken or "")
        assert [j.step.event.stream.kind for j in judged] == ["tick", "topic"]
        assert told(judged, "answered") == {"unknown"}
        assert answered.failures == 2
    assert small.outcome is Outcome.CURRENTLY_TRUE
