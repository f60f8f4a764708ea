"""Denied events that never happened, and those that are not to blame."""

from __future__ import annotations

import itertools
import json
import random
from typing import Any

import pytest

from oracle_server.core.atoms import Matches
from oracle_server.core.errors import EngineError
from oracle_server.core.events import Event
from oracle_server.core.formula.render import render
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.spec import Property, StreamSpec
from oracle_server.core.verdicts import NEGATIVE, Judged, Outcome, record
from oracle_server.engines.native import NativeEngine, engine_of
from oracle_server.engines.table import make_engines
from oracle_server.specfiles.load import parse_spec
from tests import generate
from tests.brute import truths
from tests.core.sessions import MODE, A, B, Feed, open_session, outcomes, prop
from tests.engines.test_against_brute import SEED

GUARD: dict[str, Any] = {"guards": frozenset({"/a"})}


def native(property_: Property) -> NativeEngine:
    return NativeEngine(property_.formula, property_.time)


def session_of(*properties: Property, on_deny: Any = "undo", hold: frozenset[str] = frozenset()) -> Session:
    streams = [
        StreamSpec("/a", action="filter", on_deny=on_deny, hold=hold),
        StreamSpec("/b"),
        StreamSpec("/mode", hold=frozenset({"mode"})),
    ]
    return open_session(
        list(properties), attach={"m": [A, B, MODE]}, streams=streams, maker=native, by="arrival"
    )  # fmt: skip


def decisions(judged: list[Judged]) -> list[str]:
    return [j.decision.choice for j in judged if j.decision]


@pytest.mark.parametrize(("on_deny", "then"), [("keep", "deny"), ("undo", "allow")])
def test_what_was_denied_is_not_held_against_what_follows(on_deny: str, then: str) -> None:
    session = session_of(prop("p", 'historically not {topic: "/a", v > 5}', **GUARD), on_deny=on_deny)
    feed = Feed(session)
    judged = [j for n, v in enumerate((1, 9, 2), 1) for j in feed(A, n, {"v": v}, ask=True)]
    assert decisions(judged) == ["allow", "deny", then]
    assert [j.number for j in judged] == ([1, None, 2] if on_deny == "undo" else [1, 2, 3])
    assert outcomes(judged)[1] == ("currently_false" if on_deny == "undo" else "false"), "an attempt is never final"
    assert session.judges["arrival"].counters.denied == (1 if on_deny == "undo" else 2)


def test_an_attempt_leaves_no_latch_and_holds_nothing() -> None:
    latched = prop("p", "not {v: 9}", latch=True, **GUARD)
    held = prop("q", 'not {v: 9} and ({topic: "/b"} -> not {v: 8})', **GUARD)
    session = session_of(latched, held, hold=frozenset({"v"}))
    feed = Feed(session)
    judged = feed(A, 1, {"v": 9}, ask=True) + feed(A, 2, {"v": 9}, ask=True) + feed(B, 3)
    assert decisions(judged) == ["deny", "deny"]
    assert [[v.outcome.value for v in j.verdicts] for j in judged][-1] == ["currently_true", "currently_true"]
    states = session.judges["arrival"].properties
    assert [s.violations for s in states] == [2, 2], "each attempt is one"


def test_an_attempt_leaves_what_was_held_before() -> None:
    stays = prop("q", '{topic: "/b"} -> {v: 1}')
    session = session_of(prop("p", "not {v: 9}", **GUARD), stays, hold=frozenset({"v"}))
    feed = Feed(session)
    judged = feed(A, 1, {"v": 1}, ask=True) + feed(A, 2, {"v": 9}, ask=True)
    assert decisions(judged) == ["allow", "deny"]
    assert [v.outcome.value for v in feed(B, 3)[0].verdicts] == ["currently_true", "currently_true"]


def test_events_that_were_not_asked_about_are_kept() -> None:
    session = session_of(prop("p", 'historically not {topic: "/a", v > 5}', **GUARD))
    assert outcomes(Feed(session)(A, 1, {"v": 9})) == ["false"]


def test_judging_again_undoes_again() -> None:
    there, back = (session_of(prop("p", "historically not {v: 9}", **GUARD)) for _ in range(2))
    judged = [j for n, v in enumerate((1, 9, 2, 9), 1) for j in Feed(there)(A, n, {"v": v}, ask=True)]
    assert [back.rejudge(j.order, j.step, j.judged) for j in judged] == judged


def test_a_number_names_one_step_also_in_explanations() -> None:
    """What was taken back has no number: the next event has the one that it had while it was tried."""
    guard = prop("p", '({v: 9} or {v: 8}) -> not historically {topic: "/a"}', **GUARD)
    feed = Feed(session_of(guard))
    first, attempt, kept = (j for n, v in enumerate((1, 9, 2), 1) for j in feed(A, n, {"v": v}, ask=True))
    assert [j.number for j in (first, attempt, kept)] == [1, None, 2]
    why = record(attempt, attempt.verdicts[0])["explanation"]
    assert why is not None
    assert why["text"] == (
        "p does not hold at an attempt that was taken back (0.000 s), /a (topic 2 of m): "
        "{v: 9}: holds at this attempt (0.000 s); "
        'historically {topic: "/a"}: at every one in step 1 and at this attempt'
    )
    atom, always = why["reasons"]
    event = atom["event"]
    assert event is not None
    assert (atom.get("at"), event["seq"], "step" in event) == (None, 2, False)
    assert always["window"] == [1, 1]
    (broken,) = feed(B, 4, {"v": 9})
    text = record(broken, broken.verdicts[0])["explanation"]
    assert text is None, "other streams make it true"


def test_what_an_attempt_breaks_beside_its_guard_has_its_number_where_it_passes() -> None:
    beside = prop("p", "not {v: 9}")
    feed = Feed(session_of(beside, prop("q", "not {v: 8}", **GUARD)))
    (judged,) = feed(A, 1, {"v": 9}, ask=True)
    why = record(judged, judged.verdicts[0])["explanation"]
    assert judged.number == 1
    assert why is not None
    assert why["text"].endswith("{v: 9}: holds at step 1 (0.000 s)")


def test_random_attempts_are_as_if_they_had_not_been() -> None:
    for number in range(SEED, SEED + 500):
        rng = random.Random(f"undo {number}")
        formula = generate.formula(rng, "steps", rng.randint(2, 4))
        blame: Any = rng.choice(("any", "caused"))
        session = session_of(Property("p", formula, guards=frozenset({"/a"}), blame=blame))
        steps: list[Any] = []
        for n, (_, signals) in enumerate(generate.trace(rng, 8), start=1):
            ask, known = rng.random() < 0.7, dict(signals)
            expected = truths(formula, [*steps, (n, known)], "steps")[-1]
            mends = blame == "any" or truths(formula, [*steps, (n, {})], "steps")[-1]
            (judged,) = session.ingest(Event(A, "m", n, n, n, known, ask=ask))
            outcome = judged.verdicts[0].outcome
            assert (outcome not in NEGATIVE) is expected, f"case {number}, step {n}: {render(formula)}"
            denied = ask and outcome in NEGATIVE and mends
            assert judged.decision is None or (judged.decision.choice == "deny") is denied
            if not denied:
                steps.append((n, known))
            assert session.judges["arrival"].counters.steps == len(steps)
            if not denied and session.judges["arrival"].properties[0].outcome.value in ("true", "false"):
                break


@pytest.mark.parametrize(("blame", "choices"), [("any", ["deny", "deny"]), ("caused", ["allow", "deny"])])
def test_what_withholding_cannot_mend_is_not_blamed(blame: Any, choices: list[str]) -> None:
    overdue = 'once[2:] {topic: "/b"} -> once {topic: "/mode"}'
    guard = prop("p", f"({overdue}) and not {{v: 9}}", blame=blame, **GUARD)
    session = session_of(guard, on_deny="keep")
    feed = Feed(session)
    feed(B, 1)
    feed(B, 2)
    first = feed(A, 3, {"v": 1}, ask=True)
    assert outcomes(first) == ["currently_false"], "overdue, whether it comes or not"
    feed(MODE, 4)
    second = feed(A, 5, {"v": 9}, ask=True)
    assert decisions([*first, *second]) == choices


def test_what_is_held_counts_where_an_event_is_imagined_away() -> None:
    session = session_of(prop("p", "not {mode: 1}", blame="caused", **GUARD), on_deny="keep")
    feed = Feed(session)
    feed(MODE, 1, {"mode": 1})
    assert decisions(feed(A, 2, {}, ask=True)) == ["allow"]


LIMIT = 'not {topic: "/a", v > 5}'
OPENED = [
    pytest.param(prop("p", LIMIT, latch=True, blame="caused", **GUARD), "deny deny allow", id="latched"),
    pytest.param(prop("p", f"historically {LIMIT}", blame="caused", **GUARD), "deny deny allow", id="for good"),
    pytest.param(prop("p", f"historically[:9] {LIMIT}", blame="caused", **GUARD), "deny deny allow", id="in a window"),
    pytest.param(
        prop("p", f"historically[:9] {LIMIT}", latch=True, blame="caused", **GUARD), "deny deny allow", id="both"
    ),
    pytest.param(
        prop("p", f"historically[:9ns] {LIMIT}", time="seconds", blame="caused", **GUARD), "deny deny allow", id="timed"
    ),
    pytest.param(
        prop("p", f"{LIMIT} and historically[3:9] {LIMIT}", blame="caused", **GUARD), "deny deny allow", id="later"
    ),
]  # fmt: skip


@pytest.mark.parametrize(("guard", "then"), OPENED)
def test_a_denial_that_stays_opens_the_guard_for_nothing_like_it(guard: Property, then: str) -> None:
    """What was denied and kept breaks the property by itself: one more is denied, and what adds nothing passes."""
    feed = Feed(session_of(guard, on_deny="keep"))
    first = [j for n, v in enumerate((1, 9, 0, 0, 0), 1) for j in feed(A, n, {"v": v}, ask=True)]
    assert decisions(first) == ["allow", "deny", "allow", "allow", "allow"]
    again = [j for n, v in enumerate((9, 9, 0), 6) for j in feed(A, n, {"v": v}, ask=True)]
    assert decisions(again) == then.split()


@pytest.mark.parametrize("way", ["snapshot", "records", "of a version that kept less"])
@pytest.mark.parametrize("latch", [False, True])
def test_a_restarted_guard_denies_what_it_denied(latch: bool, way: str) -> None:
    text = LIMIT if latch else f"historically {LIMIT}"
    session, again = (
        session_of(prop("p", text, latch=latch, blame="caused", **GUARD), on_deny="keep") for _ in range(2)
    )
    feed = Feed(session)
    judged = feed(A, 1, {"v": 9}, ask=True) + feed(A, 2, {"v": 9}, ask=True)
    if way == "records":
        assert [again.rejudge(j.order, j.step, j.judged) for j in judged] == judged
    else:
        saved: Any = json.loads(json.dumps(session.snapshot()))
        (state,) = saved["judges"]["arrival"]["properties"]
        if way == "of a version that kept less":
            del state["stained"]
            state["engine"] = None
        again.restore(saved, 3)
    feed = Feed(again)
    feed.seqs["m"] = itertools.count(3)
    assert decisions(feed(A, 3, {"v": 9}, ask=True) + feed(A, 4, {"v": 1}, ask=True)) == ["deny", "allow"]


@pytest.mark.parametrize("latch", [False, True])
def test_what_others_broke_is_let_pass_until_a_denied_event_may_be_the_reason(latch: bool) -> None:
    guard = prop("p", 'not {v > 5} and historically not {topic: "/b", v > 5}', latch=latch, blame="caused", **GUARD)
    session = session_of(guard, on_deny="keep")
    feed = Feed(session)
    judged = feed(A, 1, {"v": 9}, ask=True) + feed(A, 2, {"v": 1}, ask=True)
    feed(B, 3, {"v": 9})
    judged += feed(A, 4, {"v": 1}, ask=True) + feed(A, 5, {"v": 9}, ask=True)
    assert decisions(judged) == ["deny", "allow", "allow", "allow"], "/b has broken it for good, whatever /a does"


@pytest.mark.parametrize(("guards", "then"), [(["/a"], "allow"), (["/a", "/b"], "deny")])
def test_an_event_that_others_denied_is_no_excuse_where_the_property_guards_its_stream(
    guards: list[str], then: str
) -> None:
    text = 'historically not ({topic: "/b", v > 5} or {topic: "/a", v > 5})'
    caused = prop("p", text, blame="caused", guards=frozenset(guards))
    other = prop("q", '{topic: "/b"} -> {v <= 1}', guards=frozenset({"/b"}))
    streams = [StreamSpec(name, action="filter") for name in ("/a", "/b")]
    feed = Feed(open_session([caused, other], attach={"m": [A, B]}, streams=streams, maker=engine_of, by="arrival"))
    (denied,) = feed(B, 1, {"v": 9}, ask=True)
    assert denied.decision is not None
    assert "q" in denied.decision.denied_by
    assert decisions(feed(A, 2, {"v": 9}, ask=True)) == [then]


def test_a_latch_denies_what_breaks_its_formula_and_nothing_else_whoever_has_latched_it() -> None:
    guard = prop("p", '({topic: "/a"} -> {v <= 5}) and not {w > 5}', latch=True, blame="caused", **GUARD)
    feed = Feed(session_of(guard, on_deny="keep"))
    feed(B, 1, {"w": 9})
    judged = [j for n, v in enumerate((1, 9, 1, 9), 2) for j in feed(A, n, {"v": v}, ask=True)]
    assert decisions(judged) == ["allow", "deny", "allow", "deny"]
    assert outcomes(judged) == ["false"] * 4, "negative for good all the same"


@pytest.mark.parametrize(
    ("derive", "says", "choices"),
    [
        ("{}", "pattern: 'at most 2 /a within 1s'", "allow allow deny deny deny deny deny"),
        (
            "{a: {start: low, states: {low: {up: high}, high: {down: low}}}}",
            "machine: a",
            "allow deny deny deny deny deny deny",
        ),
    ],
)
def test_nor_is_what_it_left_in_derived_signals(derive: str, says: str, choices: str) -> None:
    ready = plan(
        parse_spec(
            "id: x\ndefine: {up: '{topic: /a, m: up}', down: '{topic: /a, m: down}'}\n"
            f"derive: {derive}\nordering: {{by: arrival}}\n"
            "streams: [{topic: /a, signals: {m: msg.m}, action: filter, decide_within: 9s}]\n"
            f"properties: [{{id: p, {says}, guards: [/a], blame: caused}}]\n",
            "x",
        ).spec
    )
    session = Session(ready, make_engines(ready))
    session.attach("m", [A], 0)
    feed = Feed(session)
    judged = [j for n in range(1, 8) for j in feed(A, n * 10**8, {"m": "up"}, ask=True)]
    assert decisions(judged) == choices.split()


def test_what_a_denied_event_left_in_held_signals_is_no_excuse() -> None:
    feed = Feed(session_of(prop("p", "not {v > 5}", blame="caused", **GUARD), on_deny="keep", hold=frozenset({"v"})))
    judged = [j for n, v in enumerate((9, 9, 1, 9), 1) for j in feed(A, n, {"v": v}, ask=True)]
    assert decisions(judged) == ["deny", "deny", "allow", "deny"]


def test_what_others_hold_does_not_make_one_more_of_what_adds_nothing() -> None:
    text = f"(historically {LIMIT}) and not {{mode: 1}}"
    feed = Feed(session_of(prop("p", text, blame="caused", **GUARD), on_deny="keep"))
    judged = feed(A, 1, {"v": 9}, ask=True) + feed(A, 2, {"v": 1}, ask=True)
    feed(MODE, 3, {"mode": 1})
    judged += feed(A, 4, {"v": 1}, ask=True) + feed(A, 5, {"v": 9}, ask=True)
    assert decisions(judged) == ["deny", "allow", "allow", "deny"]


def test_who_attempted_in_vain_did_not_speak_last() -> None:
    """Of two monitors that hold one signal, a tick sees what the one that spoke last holds."""
    streams = [
        StreamSpec("/a", action="filter", on_deny="undo", hold=frozenset({"v"})),
        StreamSpec("/b"),
        StreamSpec("/mode", hold=frozenset({"mode"})),
    ]
    overdue = prop("t", 'not (once[5ns:] {topic: "/b"} and {mode: 1})', time="seconds")
    for attempts in (0, 1):
        session = open_session(
            [overdue, prop("p", "not {v: 9}", **GUARD)], attach={}, streams=streams, maker=native, by="arrival"
        )
        feed = Feed(session)
        feed(MODE, 1, {"mode": 1})
        feed(MODE, 2, {"mode": 2}, monitor="n")
        feed(B, 3, monitor="n")
        for n in range(attempts):
            assert decisions(feed(A, 4 + n, {"v": 9}, ask=True)) == ["deny"]
        assert session.advance(20) == [], "mode is 2"


def test_a_property_whose_engine_fails_at_an_attempt_does_not_stand_as_before() -> None:
    class Failing(NativeEngine):
        def step(self, time: int, matches: Matches) -> Outcome:
            if time == 2:
                raise EngineError("it had enough")
            return super().step(time, matches)

    guard = prop("p", "not {v: 9}", **GUARD)
    streams = [StreamSpec("/a", action="filter", on_deny="undo")]
    session = open_session(
        [guard], attach={}, streams=streams, maker=lambda p: Failing(p.formula, p.time), by="arrival"
    )
    feed = Feed(session)
    assert decisions(feed(A, 1, ask=True) + feed(A, 2, ask=True)) == ["allow", "deny"]
    state = session.judges["arrival"].properties[0]
    assert (state.outcome.value, state.failures) == ("unknown", 1)
