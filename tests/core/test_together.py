"""All that a session can do, together: attempts that are undone, what is held, latches, deadlines, two monitors.

So too what is missing from the beginning on, and streams that are bypassed.

A session that is stopped again and again, and goes on from a snapshot or by judging again, is told the same as one
that is not.
"""

from __future__ import annotations

import json
import random
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.bypass import Bypass
from oracle_server.core.events import Event
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Bound, Once
from oracle_server.core.ordering.simulated import ClockReading
from oracle_server.core.session import Session
from oracle_server.core.spec import Property, StreamSpec
from oracle_server.core.verdicts import FINAL, NEGATIVE, Judged, Outcome
from oracle_server.engines.native import NativeEngine
from tests import brute, generate
from tests.brute import TimedSignals
from tests.core.sessions import MODE, A, B, U, open_session, prop
from tests.core.test_ticks import in_nanoseconds
from tests.engines.test_against_brute import SEED

STREAMS = (
    StreamSpec("/a", action="filter", on_deny="undo", hold=frozenset({"v"})),
    StreamSpec("/b"),
    StreamSpec("/u", ordered=False, action="filter", on_deny="undo"),
    StreamSpec("/mode", hold=frozenset({"mode"}), signals={"mode": "msg.w + 0"}),
)
GUARDS = frozenset({"/a", "/u"})
PROPERTIES = (
    prop("small", "not {v: 3}", guards=GUARDS),
    prop("caused", "pre {v: 1} -> once[:2] {mode: 1}", guards=GUARDS, blame="caused"),
    prop("latched", "not once[5ns:9ns] {mode: 2}", time="seconds", latch=True),
    prop("since", "{mode: 1} since[:7ns] {v: 1}", time="seconds"),
    prop(
        "answered",
        'once[4ns:] {topic: "/b"} -> once[:6ns] {topic: "/u"}',
        time="seconds",
        guards=GUARDS,
        blame="caused",
    ),
    prop("again", "forall[x]. {v: *x} -> pre once {mode: *x}"),
    prop("there", 'once[:15ns] {topic: "/b"} and once[2ns:30ns] {v: 2}', time="seconds", guards=GUARDS),
    prop("seen", "once {v: 2} and historically[3:] not {mode: 1}", latch=True),
)
MONITORS = ("m", "n")

moments = st.lists(
    st.tuples(
        st.sampled_from(("event", "event", "event", "event", "clock", "wait", "bypass", "snapshot", "again")),
        st.sampled_from(MONITORS),
        st.sampled_from((A, B, U, MODE)),
        st.integers(0, 8),
        st.integers(-2, 12),
        st.sampled_from((1, 2, 3, "x", None)),
        st.booleans(),
        st.sampled_from((0, 0, 0, 1)),
    ),
    max_size=25,
)


def native(property_: Property) -> NativeEngine:
    return NativeEngine(property_.formula, property_.time)


def opened(ordering: dict[str, Any], begun: int | None = None) -> Session:
    return open_session(PROPERTIES, attach={}, streams=STREAMS, maker=native, begun=begun, **ordering)


def attached(session: Session, now: int) -> list[Judged]:
    return [judged for name in MONITORS for judged in session.attach(name, [A, B, U, MODE], now)]


def come_back(kind: str, stopped: Session, before: list[Judged], ordering: dict[str, Any]) -> Session:
    """What a restart makes of a session and its history."""
    session = opened(ordering, stopped.begun)
    if kind == "snapshot":
        session.restore(json.loads(json.dumps(stopped.snapshot())), len(before) * len(PROPERTIES) + 1)
        return session
    for judged in before:
        if all(v.degraded and not v.bypassed for v in judged.verdicts):
            session.judges[judged.order].degrade()
        session.judges[judged.order].bypass([i for i, v in enumerate(judged.verdicts) if v.bypassed])
        session.rejudge(judged.order, judged.step, judged.judged)
    return session


@settings(max_examples=200, deadline=None)
@given(
    found=moments,
    by=st.sampled_from(("publication", "arrival")),
    late=st.sampled_from(("judge", "skip")),
    max_delay=st.sampled_from((0, 5, None)),
    capacity=st.sampled_from((2, 100)),
)
def test_a_session_that_is_stopped_again_and_again_goes_on_as_one_that_is_not(
    found: list[Any], by: str, late: str, max_delay: int | None, capacity: int
) -> None:
    ordering = {"by": by, "late": late, "max_delay": max_delay, "capacity": capacity, "max_skew": 6}
    whole, cut = opened(ordering), opened(ordering)
    history: list[Judged] = attached(whole, 100)
    assert attached(cut, 100) == history
    now, bypassed = 100, set[str]()
    for n, (what, monitor, stream, gap, delay, value, ask, lost) in enumerate(found, 1):
        now += gap
        told: list[list[Judged]] = []
        if what == "bypass":
            bypassed ^= {monitor}
        for session in (whole, cut):
            if what == "event":
                data = {"v": value, "w": value}
                event = Event(stream, monitor, n, max(1, now - delay), now, data, ask=ask, lost=lost)
                told.append(session.ingest(event))
            elif what == "clock":
                told.append(session.clock(monitor, [ClockReading(stream, now - max(0, delay))], now))
            elif what == "bypass":
                session.bypass(monitor, {stream: Bypass("by /rogue", now)} if monitor in bypassed else {})
                told.append([])
            elif what == "wait":
                told.append(session.advance(now))
            else:
                told.append([*session.finish(now), *(j for name in MONITORS for j in session.detach(name, now))])
        assert told[0] == told[1]
        history += told[0]
        if what in ("snapshot", "again"):
            cut = come_back(what, cut, history, ordering)
            for session in (whole, cut):
                for name in MONITORS:  # as they report anew
                    session.bypass(name, {B: Bypass("by /rogue", now)} if name in bypassed else {})
            begun = attached(whole, now)
            assert attached(cut, now) == begun
            history += begun
            for one, other in zip(whole.judges.values(), cut.judges.values(), strict=True):
                assert [(s.outcome, s.failures, s.violations) for s in one.properties] == [
                    (s.outcome, s.failures, s.violations) for s in other.properties
                ]
                assert one.counters == other.counters
    assert [v.n for judged in history for v in judged.verdicts] == list(range(1, len(history) * len(PROPERTIES) + 1))
    attempts = [j for j in history if not j.step.skipped and j.decision and j.decision.choice == "deny"]
    assert not any(v.outcome in FINAL for judged in attempts for v in judged.verdicts)


def test_steps_and_deadlines_are_what_the_table_says_with_attempts_undone_and_signals_held() -> None:
    """And what is final stays, whatever comes."""
    streams = (StreamSpec("/a", action="filter", on_deny="undo"), StreamSpec("/mode", hold=frozenset({"c"})))
    ticks = 0
    for number in range(SEED, SEED + 400):
        rng = random.Random(f"together {number}")
        time: Any = rng.choice(("steps", "seconds", "seconds"))
        formula = generate.formula(rng, time, rng.randint(2, 4), 1)
        formula = formula if time == "steps" else in_nanoseconds(formula)
        if rng.random() < 0.2:
            formula = Once(formula, Bound(0, rng.randint(0, 9)))
        text = f"case {number}: {render(formula, time)}"
        guarded = Property("p", formula, text, time=time, guards=frozenset({"/a"}))
        session = open_session([guarded], attach={}, streams=streams, maker=native, by="arrival")
        session.attach("m", [], 1)
        state = session.judges["arrival"].properties[0]
        steps: list[TimedSignals] = []
        held: dict[str, dict[str, Any]] = {}
        now, final = 1, None
        for seq in range(1, rng.randint(4, 12)):
            now += rng.choice((0, 1, 2, 5))
            monitor, stream, ask = rng.choice(MONITORS), rng.choice((A, A, MODE)), rng.random() < 0.6
            own = {key: rng.choice((1, 2)) for key in ("ab" if stream == A else "c") if rng.random() < 0.7}
            for judged in session.ingest(Event(stream, monitor, seq, now, now, own, ask=ask)):
                if judged.step.event.stream.kind == "tick":
                    signals = {k: v for known in held.values() for k, v in known.items()}
                    moment = (judged.step.stamp, signals)
                    ticks += 1
                else:
                    if stream == MODE:
                        held.pop(monitor, None)
                        held[monitor] = own
                    moment = (now, {**held.get(monitor, {}), **own})
                holds = brute.judged(formula, [*steps, moment], time, 1)[-1]
                outcome = judged.verdicts[0].outcome
                assert (None if outcome is Outcome.UNKNOWN else outcome not in NEGATIVE) is holds, text
                assert final is None or outcome.current is final.current, text
                denied = judged.decision is not None and judged.decision.choice == "deny"
                assert denied is (ask and stream == A and not holds and judged.decision is not None)
                if judged.number is not None:
                    assert not (denied and stream == A)
                    steps.append(moment)
                    final = outcome if outcome in FINAL else None
                    assert state.outcome is outcome
    assert ticks > 20, "there are deadlines in this"
