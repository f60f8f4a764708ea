"""New forms of formulas in sessions: at deadlines, where events are taken back, and in both orders."""

from __future__ import annotations

from oracle_server.core.formula.definitions import defined
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.spec import Property, StreamSpec
from oracle_server.core.verdicts import Judged
from oracle_server.engines.native import NativeEngine
from tests.core.sessions import A, B, Feed, open_session, outcomes, prop

HOLDING = (
    StreamSpec("/a", signals={"speed": "msg.speed"}, hold=frozenset({"speed"})),
    StreamSpec("/b", signals={"limit": "msg.limit"}, hold=frozenset({"limit"})),
)


def native(property_: Property) -> NativeEngine:
    return NativeEngine(property_.formula, property_.time)


def decisions(judged: list[Judged]) -> list[str]:
    return [j.decision.choice for j in judged if j.decision]


def test_what_lasts_too_long_is_a_violation_when_its_time_is_over() -> None:
    names = defined({"fast": "{speed > limit}"}, [])
    text = "not lasting[2us] fast"
    session = open_session(
        [Property("p", parse_formula(text, "seconds", names), text, time="seconds")],
        attach={"m": [A, B]}, streams=HOLDING, maker=native, by="arrival",
    )  # fmt: skip
    feed = Feed(session)
    judged = [*feed(B, 1_000, {"limit": 1}), *feed(A, 2_000, {"speed": 3})]
    assert outcomes(judged) == ["currently_true", "currently_true"]
    (tick,) = session.advance(5_000)
    assert (tick.step.time, outcomes([tick])) == (4_000, ["currently_false"])
    explanation = tick.verdicts[0].explanation
    assert explanation is not None
    assert "lasting[2us] fast: fast held at step 2" in str(explanation.text)
    assert "its deadline of 2us ran out" in str(explanation.text)
    assert outcomes(feed(B, 6_000, {"limit": 4})) == ["currently_true"]


def test_a_first_event_that_is_taken_back_was_not_the_first() -> None:
    guard = prop("p", "first -> not {v: 9}", guards=frozenset({"/a"}))
    streams = [StreamSpec("/a", action="filter", on_deny="undo"), StreamSpec("/b")]
    feed = Feed(open_session([guard], attach={"m": [A, B]}, streams=streams, maker=native, by="arrival"))
    judged = [j for n, v in enumerate((9, 9, 1, 9), 1) for j in feed(A, n, {"v": v}, ask=True)]
    assert decisions(judged) == ["deny", "deny", "allow", "allow"]


def test_a_limit_that_arrives_late_counts_by_publication_alone() -> None:
    session = open_session(
        [prop("p", '{topic: "/a"} -> {speed <= limit}')],
        attach={"m": [A, B]}, streams=HOLDING, maker=native, by="both", max_delay=50,
    )  # fmt: skip
    feed = Feed(session)
    judged = [*feed(A, 20, {"speed": 2}, arrived=20), *feed(B, 10, {"limit": 3}, arrived=30)]
    judged += session.finish(1_000)
    found = {order: outcomes(j for j in judged if j.order == order) for order in ("arrival", "publication")}
    assert found == {
        "arrival": ["currently_false", "currently_true"],
        "publication": ["currently_true", "currently_true"],
    }
