"""A property that costs too much, or whose engine fails: it is unknown for good, and the others are judged on."""

from __future__ import annotations

from typing import Any, Literal

import pytest

from oracle_server.core.atoms import Matches
from oracle_server.core.engine import MAX_WORK, MAX_WORK_TOGETHER
from oracle_server.core.errors import EngineError
from oracle_server.core.events import Order
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


class Back(Recorder):
    """One whose steps can be taken back."""

    def mark(self) -> None: ...
    def back(self) -> None: ...
    def keep(self) -> None: ...
    def next_deadline(self, after: int) -> int | None: ...


def test_an_engine_that_fails_at_an_attempt_judges_no_more_though_the_attempt_never_happened() -> None:
    engine = Back([Outcome.CURRENTLY_TRUE, EngineError("enough"), Outcome.CURRENTLY_TRUE])
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


def test_a_latched_guard_whose_engine_fails_denies_though_it_let_pass_what_was_not_to_blame() -> None:
    without = Outcome.CURRENTLY_TRUE
    at: list[Outcome | Exception] = [Outcome.CURRENTLY_FALSE, Outcome.CURRENTLY_TRUE, EngineError("enough")]
    guard = prop("p", "{v: 1}", guards=frozenset({"/a"}), latch=True, blame="caused")
    session = open_session(
        [guard], attach={"m": [A]}, streams=[StreamSpec("/a", action="filter")],
        maker=lambda _: Back([says for outcome in at for says in (without, outcome)]), by="arrival",
    )  # fmt: skip
    feed = Feed(session)
    judged = [j for n in range(1, 5) for j in feed(A, n, {"v": 1}, ask=True)]
    assert [j.decision.choice for j in judged if j.decision] == ["deny", "allow", "deny", "deny"]


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


def many_values(ids: int, count: int) -> tuple[Session, Feed]:
    """Properties of which each looks at all values that were seen once `w` is 1."""
    streams = [StreamSpec("/a"), StreamSpec("/b")]
    session = open_session(
        [prop(f"p{i}", "exists[x]. once{v: *x} and {w: 1}") for i in range(count)],
        attach={"m": [A, B]}, streams=streams, maker=lambda p: NativeEngine(p.formula, p.time), by="arrival",
    )  # fmt: skip
    feed = Feed(session)
    for n in range(1, ids + 1):
        feed(A, n, {"v": n})
    return session, feed


def test_a_step_of_many_properties_costs_no_more_together_than_they_may() -> None:
    session, feed = many_values(15_000, 8)
    judged = feed(A, 20_000, {"w": 1})
    states = session.judges["arrival"].properties
    cost = sum(state.work for state in states)
    assert cost <= MAX_WORK_TOGETHER
    assert [j.step.event.seq for j in judged] == [15_001]
    within = [state for state in states if state.broken is None]
    assert len(within) == MAX_WORK_TOGETHER // 15_000, "those that come first are judged"
    assert {state.outcome for state in within} == {Outcome.CURRENTLY_TRUE}
    assert all("cost too much together" in (state.broken or "") for state in states if state not in within)


def test_one_property_may_look_at_many_values_whatever_stands_beside_it() -> None:
    session, feed = many_values(15_000, 1)
    feed(A, 20_000, {"w": 1})
    (state,) = session.judges["arrival"].properties
    assert state.broken is None
    assert state.work >= 15_000


def test_a_key_costs_more_where_more_is_asked_of_it() -> None:
    def cost(operands: int) -> int:
        body = " and ".join(f"not {{w: {i}}}" for i in range(operands))
        property_ = prop("p", f"exists[x]. once{{v: *x}} and {body}")
        session = open_session(
            [property_], attach={"m": [A]}, streams=[StreamSpec("/a")], maker=lambda p: NativeEngine(p.formula),
            by="arrival",
        )  # fmt: skip
        feed = Feed(session)
        for n in range(1, 101):
            feed(A, n, {"v": n})
        feed(A, 1000, {"w": 1})
        return session.judges["arrival"].properties[0].work

    assert cost(80) > 9 * cost(5)


def test_deadlines_of_many_properties_cost_no_more_together_than_they_may() -> None:
    text = "not exists[i]. once[5s:]{v: *i} and not once{w: *i} and pre {v: 0}"
    session = opened(*[prop(f"p{i}", text, time="seconds") for i in range(30)])
    feed = Feed(session)
    for n in range(1, 151):
        feed(A, n * 1000, {"v": n})
    session.advance(60 * SECOND)
    states = session.judges["arrival"].properties
    assert all(state.idle_work < MAX_WORK for state in states), "each by itself costs less"
    assert sum(state.idle_work for state in states) <= MAX_WORK
    assert any("deadlines cost too much" in (state.broken or "") for state in states)


class Dear(Recorder):
    """An engine whose every step and tick costs 15,000, with a deadline 5 s after each step."""

    work, may = 15_000, MAX_WORK

    def allow(self, work: int) -> None:
        self.may = work

    def step(self, time: int, matches: Matches) -> Outcome:
        if self.work > self.may:
            raise EngineError("too much")
        return super().step(time, matches)

    def mark(self) -> None: ...
    def back(self) -> None: ...
    def keep(self) -> None: ...
    def next_deadline(self, after: int) -> int | None:
        return after // (10 * SECOND) * 10 * SECOND + 5 * SECOND if after % (10 * SECOND) == 0 else None


def test_what_deadlines_cost_is_forgotten_with_the_next_step() -> None:
    """Else a session would come to its end by what all of its deadlines cost, however few there are at once."""
    engine = Dear([Outcome.CURRENTLY_TRUE, Outcome.CURRENTLY_FALSE] * 10)
    session = open_session(
        [prop("p", "{v: 1}", time="seconds")], attach={"m": [A, B]}, maker=lambda _: engine, by="arrival"
    )
    feed = Feed(session)
    judged = [j for n in range(1, 11) for j in feed(A, n * 10 * SECOND) + session.advance(n * 10 * SECOND + 6 * SECOND)]
    assert outcomes(judged) == ["currently_true", "currently_false"] * 10
    assert 10 * Dear.work > MAX_WORK


@pytest.mark.parametrize(("by", "judged"), [("publication", 5), ("both", 2)])
def test_of_two_orders_each_has_half_of_what_a_step_may_cost(by: Order | Literal["both"], judged: int) -> None:
    properties = [prop(f"p{i}", "{v: 1}") for i in range(8)]
    session = open_session(properties, attach={"m": [A, B]}, maker=lambda _: Dear(), by=by)
    Feed(session)(A, 1000)
    session.finish(2000)
    for judge in session.judges.values():
        assert [state.broken is None for state in judge.properties] == [True] * judged + [False] * (8 - judged)


def test_of_a_thousand_violations_at_once_some_are_explained_and_all_are_told() -> None:
    text = "once[:200]{v: 3} or once[:200]({v: 5} and once[:200]{w: 6}) or not {w: 1}"
    properties = [prop(f"p{i}", text) for i in range(300)]
    session = open_session(
        properties, attach={"m": [A]}, streams=[StreamSpec("/a")], maker=lambda p: NativeEngine(p.formula), by="arrival"
    )
    feed = Feed(session)
    for n in range(1, 301):
        feed(A, n, {"v": 7, "w": 0})
    (judged,) = feed(A, 1000, {"v": 7, "w": 1})
    explained = [v.explanation.why is not None for v in judged.verdicts if v.explanation is not None]
    assert len(explained) == 300
    assert explained == sorted(explained, reverse=True)
    assert 2 <= sum(explained) < 100


def owing(text: str, **more: Any) -> tuple[Session, Feed]:
    """What waits for what comes may look at 500 values for one step, and at 50 on average."""
    session = open_session(
        [prop("owing", text, time="seconds", **more), prop("small", "{v > 0}")], attach={"m": [A, B]},
        streams=[StreamSpec("/a"), StreamSpec("/b")], by="arrival",
        maker=lambda p: NativeEngine(p.formula, p.time, share=0.01),
    )  # fmt: skip
    return session, Feed(session)


@pytest.mark.parametrize("goal", ["always[:1h] ({speed: *} -> {speed <= *x})", "eventually[:1h] next {speed: *x}"])
@pytest.mark.parametrize("count", [50, 60])
def test_what_is_open_and_looked_at_again_at_each_step_is_counted(goal: str, count: int) -> None:
    """Else one property could take seconds a step, and hold up all other sessions for as long as it is judged."""
    session, feed = owing(f"forall[x]. {{limit: *x}} -> {goal}")
    for n in range(1, count + 1):
        feed(A, n * 1000, {"limit": 1000 + n})
    judged = [j for n in range(1, 100) for j in feed(B, SECOND + n, {"speed": n % 7, "v": 1})]
    state, small = session.judges["arrival"].properties
    if count == 50:
        assert state.broken is None
        assert (state.pending, state.work) == (50, 50)
    else:
        assert "its steps cost too much" in (state.broken or "")
    assert told(judged, "small") == {"currently_true"}
    assert small.broken is None


def test_what_is_open_and_sleeps_costs_nothing() -> None:
    session, feed = owing("forall[g]. {goal: *g} -> eventually[:1h] {done: *g}")
    for n in range(1, 2_000):
        feed(A, n * 1000, {"goal": n})
        feed(B, n * 1000 + 1, {"speed": n})
    state, _ = session.judges["arrival"].properties
    assert (state.broken, state.pending, state.work) == (None, 1_999, 0)


@pytest.mark.parametrize(("apart", "violations"), [(0, 0), (1, 600)])
def test_deadlines_of_one_time_are_counted_and_those_of_many_times_are_all_told(apart: int, violations: int) -> None:
    session, feed = owing("{goal} -> eventually[:5s] {done}")
    for n in range(600):
        feed(A, SECOND + n * apart, {"goal": True})
    session.advance(60 * SECOND)
    state, _ = session.judges["arrival"].properties
    assert state.violations == violations
    assert (state.broken is None) is bool(apart)
    assert apart or "500 obligations may run out at once" in (state.broken or "")
