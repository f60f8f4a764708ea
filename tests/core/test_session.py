"""A session's verdicts: what is judged, unknown, degraded, denied and counted."""

from __future__ import annotations

import pytest

from oracle_server.core.errors import EngineError
from oracle_server.core.spec import StreamSpec
from oracle_server.core.verdicts import Decision, Outcome, record
from tests.core.sessions import (
    MODE,
    REQUEST,
    RESPONSE,
    STREAMS,
    A,
    B,
    Feed,
    Recorder,
    U,
    degraded,
    open_session,
    outcomes,
    prop,
    reelay,
)

ONE = prop("one", '{topic: "/a"} -> {v: 1}')
SEEN = prop("seen", "once {v: 9}")


def test_verdicts_are_numbered_without_gaps_and_steps_by_order() -> None:
    session = open_session([ONE, SEEN], attach={"m": [A, B]}, by="both", late="skip")
    feed = Feed(session)
    judged = feed(A, 10) + feed(B, 5) + feed(B, 20) + feed(A, 7, arrived=21) + session.finish(90)
    assert [v.n for j in judged for v in j.verdicts] == list(range(1, 17))
    by_order = {order: [j.number for j in judged if j.order == order] for order in ("publication", "arrival")}
    assert by_order == {"publication": [1, 2, None, 3], "arrival": [1, 2, 3, 4]}
    steps = {order: (j.counters.steps, j.counters.skipped) for order, j in session.judges.items()}
    assert steps == {"publication": (3, 1), "arrival": (4, 0)}


def test_a_late_event_is_marked_and_judged() -> None:
    session = open_session([prop("before", "pre {v: 1}")], attach={"m": [A]})
    feed = Feed(session)
    judged = feed(A, 100, {"v": 1}) + feed(A, 90, {"v": 2}, arrived=101) + feed(A, 100, {"v": 3}, arrived=102)
    assert [(j.step.late, j.number) for j in judged] == [(False, 1), (True, 2), (False, 3)]
    assert outcomes(judged) == ["currently_false", "currently_true", "currently_false"]
    assert degraded(judged) == [False] * 3
    assert session.judges["publication"].counters.late == 1


def test_a_late_event_may_be_skipped() -> None:
    """It is unknown, what follows is degraded, and no formula has seen it."""
    session = open_session([SEEN, ONE], attach={"m": [A]}, late="skip")
    feed = Feed(session)
    judged = feed(A, 100, {"v": 1}) + feed(A, 90, {"v": 9}, arrived=101) + feed(A, 110, {"v": 1})
    assert outcomes(judged, "seen") == ["currently_false", "unknown", "currently_false"]
    assert outcomes(judged, "one") == ["currently_true", "unknown", "currently_true"]
    assert degraded(judged, "seen") == degraded(judged, "one") == [False, False, True]
    assert [(j.step.late, j.number) for j in judged] == [(False, 1), (True, None), (False, 2)]


def test_what_follows_a_loss_is_degraded() -> None:
    session = open_session([ONE, SEEN], attach={"m": [A]})
    feed = Feed(session)
    judged = feed(A, 10, {"v": 1}) + feed(A, 20, {"v": 1}, lost=3) + feed(A, 30, {"v": 1})
    assert degraded(judged, "one") == degraded(judged, "seen") == [False, True, True]
    assert outcomes(judged, "one") == ["currently_true"] * 3
    assert session.judges["publication"].counters.lost == 3


def test_what_left_for_want_of_room_degrades() -> None:
    session = open_session([ONE], attach={"m": [A, B]}, capacity=1)
    feed = Feed(session)
    assert feed(A, 10, {"v": 1}) == []
    (forced,) = feed(A, 20, {"v": 1})
    assert forced.step.forced
    assert degraded([forced]) == [True]


def test_a_failed_signal_makes_what_reads_it_unknown() -> None:
    """Only what reads it on that stream, and degrades no other property."""
    streams = [StreamSpec("/a", signals={"x": "msg.x + 1", "y": "msg.y"}), StreamSpec("/b", signals={"x": "msg.x"})]
    properties = [
        prop("x", "historically {x: 1}"),
        prop("y", "once {y: 1}"),
        prop("elsewhere", 'not once {topic: "/b", x: 1}'),
    ]
    session = open_session(properties, attach={"m": [A, B]}, streams=streams, by="arrival")
    feed = Feed(session)
    judged = feed(A, 10, {"x": 0}) + feed(A, 20, {"x": "0", "y": 1}) + feed(A, 30, {"x": 0}) + feed(A, 40, {})
    assert outcomes(judged, "x")[:2] == ["currently_true", "unknown"]
    assert degraded(judged, "x") == [False, False, True, True]
    assert outcomes(judged, "y") == ["currently_false", "true", "true", "true"]
    assert outcomes(judged, "elsewhere") == ["currently_true"] * 4
    assert degraded(judged, "y") == degraded(judged, "elsewhere") == [False] * 4
    assert [p.failures for p in session.judges["arrival"].properties] == [1, 0, 0]


def test_an_absent_signal_is_no_failure() -> None:
    session = open_session([prop("p", "{v: 1}")], attach={"m": [A]})
    feed = Feed(session)
    judged = feed(A, 1, {"v": 1}) + feed(A, 2, {}) + feed(A, 3, {"v": None}) + feed(A, 4, {"v": [1]}) + feed(A, 5, "v")
    assert outcomes(judged) == ["currently_true", *["currently_false"] * 4], "nothing persists"
    assert degraded(judged) == [False] * 5


def test_decisions_name_the_guards_that_deny() -> None:
    guards = frozenset({"/a"})
    properties = [
        prop("low", "{v < 5}", guards=guards),
        prop("even", "{v != 1, v != 7}", guards=guards),
        prop("idle", "{v > 99}"),
        prop("other", "{v > 99}", guards=frozenset({"/b"})),
    ]
    session = open_session(properties, attach={"m": [A, B]}, by="arrival")
    feed = Feed(session)
    asked = [feed(A, n, {"v": v}, ask=True)[0].decision for n, v in enumerate((2, 1, 7, float("nan"), 4), 1)]
    allow, both = Decision("allow", ()), Decision("deny", ("low", "even"))
    assert asked == [allow, Decision("deny", ("even",)), both, both, allow], "what is unknown is denied too"
    assert feed(A, 10, {"v": 1})[0].decision is None
    assert feed(B, 11, {"v": 1}, ask=True)[0].decision == Decision("deny", ("other",))
    assert session.judges["arrival"].counters.denied == 4


def test_what_is_skipped_is_denied() -> None:
    session = open_session([prop("p", "once {v: 1}", guards=frozenset({"/a"})), SEEN], attach={"m": [A]}, late="skip")
    feed = Feed(session)
    assert feed(A, 100, {"v": 1}, ask=True)[0].decision == Decision("allow", ())
    assert feed(A, 90, {"v": 1}, ask=True, arrived=101)[0].decision == Decision("deny", ("p",))


def test_requests_and_responses_are_guarded_and_tied_by_their_call() -> None:
    formula = (
        'forall[c]. {service: "/s", kind: response, call: *c} -> '
        'once {service: "/s", kind: request, call: *c, monitor: m}'
    )
    session = open_session(
        [prop("paired", formula, guards=frozenset({"/s"}))], attach={"m": [REQUEST, RESPONSE]}, by="arrival"
    )
    feed = Feed(session)
    judged = feed(REQUEST, 1, {"kind": "response", "call": 8}, call=7, ask=True)
    judged += feed(RESPONSE, 2, {"call": 7}, call=8, ask=True) + feed(RESPONSE, 3, call=7, ask=True)
    assert outcomes(judged) == ["currently_true", "currently_false", "currently_true"]
    assert [j.decision.choice for j in judged if j.decision] == ["allow", "deny", "allow"]


def test_what_every_event_says_of_itself_goes_over_what_it_carries() -> None:
    names = ("topic", "kind", "monitor")
    session = open_session(
        [prop("p", 'exists[x]. {topic: *x, monitor: m} and {topic: "/b"}')],
        attach={"m": [A]},
        streams=[StreamSpec("/a", signals=dict.fromkeys(names, "msg.name"))],
    )
    (judged,) = Feed(session)(A, 1, {"name": "/b"})
    assert outcomes([judged]) == ["currently_false"]
    why = judged.verdicts[0].explanation
    assert why
    assert [why.signals[name] for name in names] == ["/a", "topic", "m"]


def test_a_latched_property_stays_negative() -> None:
    session = open_session([prop("p", "{v: 1}"), prop("l", "{v: 1}", latch=True)], attach={"m": [A]})
    feed = Feed(session)
    judged = [j for n, v in enumerate((1, 2, 1, 2), 1) for j in feed(A, n, {"v": v})]
    assert outcomes(judged, "p") == ["currently_true", "currently_false"] * 2
    assert outcomes(judged, "l") == ["currently_true", "false", "false", "false"]
    assert [p.violations for p in session.judges["publication"].properties] == [2, 1]


def test_a_violation_is_becoming_negative() -> None:
    session = open_session([prop("p", "{v < 5}")], attach={"m": [A]})
    feed = Feed(session)
    judged = [j for n, v in enumerate((1, 7, 8, "NaN", 9, 2, 6), 1) for j in feed(A, n, {"v": v})]
    violations = [(v.n, v.explanation) for j in judged for v in j.verdicts if v.explanation]
    assert [n for n, _ in violations] == [2, 7], "what is unknown in between makes no new violation"
    assert [why.signals["v"] for _, why in violations] == [7, 6]
    state = session.judges["publication"].properties[0]
    assert (state.violations, state.first_violation, state.outcome) == (2, 2, Outcome.CURRENTLY_FALSE)
    assert (state.first_violation_step, state.first_violation_at) == (2, judged[1].step.stamp)
    written = record(judged[1], judged[1].verdicts[0])
    assert written["violation"]
    assert written["explanation"] is not None
    assert "{v < 5}" in written["explanation"]["text"]
    assert record(judged[2], judged[2].verdicts[0])["explanation"] is None


def test_held_signals_are_held_per_monitor() -> None:
    formula = '{topic: "/a"} -> {mode: auto}'
    session = open_session([prop("p", formula)], attach={"m": [A, MODE], "n": [A, MODE]}, by="arrival")
    feed = Feed(session)
    assert outcomes(feed(A, 1)) == ["currently_false"]
    feed(MODE, 2, {"mode": "auto"})
    feed(MODE, 3, {"mode": "manual"}, monitor="n")
    assert outcomes(feed(A, 4) + feed(A, 5) + feed(A, 6, monitor="n")) == ["currently_true"] * 2 + ["currently_false"]
    feed(MODE, 7, {"mode": None})
    assert outcomes(feed(A, 8)) == ["currently_false"], "the last message had none"


def test_a_held_signal_that_failed_stays_unknown_until_the_next_message() -> None:
    streams = [StreamSpec("/a"), StreamSpec("/mode", hold=frozenset({"mode"}), signals={"mode": "msg.mode + 0"})]
    properties = [prop("p", '{topic: "/a"} -> {mode: 1}'), prop("q", '{topic: "/a"} -> {v: 1}')]
    session = open_session(properties, attach={}, streams=streams, by="arrival")
    feed = Feed(session)
    feed(MODE, 1, {"mode": 1})
    feed(MODE, 2, {"mode": "?"})
    judged = feed(A, 3, {"v": 1}) + feed(A, 4, {"v": 1}, monitor="n")
    assert (outcomes(judged, "p"), outcomes(judged, "q")) == (["unknown", "currently_false"], ["currently_true"] * 2)
    feed(MODE, 5, {"mode": 1})
    assert outcomes(feed(A, 6, {"v": 1}), "p") == ["currently_true"]


def test_a_held_signal_that_failed_does_not_touch_a_stream_s_own_of_that_name() -> None:
    hold = StreamSpec("/mode", hold=frozenset({"mode"}), signals={"mode": "msg.mode + 0"})
    own = StreamSpec("/a", signals={"mode": "msg.mode"})
    properties = [prop("p", '{topic: "/a"} -> {mode: 7}')]
    session = open_session(properties, attach={}, streams=[hold, own, StreamSpec("/b")], by="arrival")
    feed = Feed(session)
    feed(MODE, 1, {"mode": "?"})
    assert outcomes(feed(A, 2, {"mode": 7}) + feed(A, 3, {})) == ["currently_true", "unknown"]


@pytest.mark.parametrize("error", [EngineError("too many values"), RuntimeError(), MemoryError("full")])
def test_an_engine_that_raises_ends_its_property_alone(error: Exception) -> None:
    broken = prop("broken", "once {v: 1}", guards=frozenset({"/a"}))
    session = open_session(
        [broken, SEEN],
        attach={"m": [A]},
        maker=lambda p: Recorder([Outcome.CURRENTLY_TRUE, error]) if p is broken else reelay(p),
    )
    feed = Feed(session)
    judged = [j for n, v in enumerate((1, 2, 9, 4), 1) for j in feed(A, n, {"v": v}, ask=True)]
    assert outcomes(judged, "broken") == ["currently_true", "unknown", "unknown", "unknown"]
    assert degraded(judged, "broken") == [False, False, True, True]
    assert outcomes(judged, "seen") == ["currently_false", "currently_false", "true", "true"]
    assert degraded(judged, "seen") == [False] * 4
    assert [j.decision for j in judged] == [Decision("allow", ()), *[Decision("deny", ("broken",))] * 3]
    state = session.judges["publication"].properties[0]
    assert state.broken == (str(error) or "RuntimeError")


def test_an_unordered_event_reaches_the_formulas() -> None:
    session = open_session([SEEN], attach={"m": [A, B, U]}, streams=STREAMS)
    assert outcomes(Feed(session)(U, 1, {"v": 9})) == ["true"]
