"""Judging again what was judged: a fresh session comes back to where another one stood, and goes on as it does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from oracle_server.core.events import StreamKey
from oracle_server.core.session import Session
from oracle_server.core.spec import Property
from oracle_server.core.verdicts import Judged
from oracle_server.engines.native import NativeEngine
from tests.core.sessions import MODE, A, B, Digest, Feed, Maker, U, degraded, open_session, prop, reelay


@dataclass(frozen=True)
class Happening:
    """An event: when it arrived after the one before, how long it was under way, and what it carried."""

    stream: StreamKey
    monitor: str
    gap: int
    delay: int
    value: object
    lost: int
    ask: bool


happenings = st.lists(
    st.builds(
        Happening,
        st.sampled_from((A, B, U, MODE)),
        st.sampled_from(("m", "n")),
        st.integers(0, 30),
        st.integers(-40, 100),
        st.sampled_from((1, "1", None, "NaN", 2)),
        st.sampled_from((0, 0, 0, 0, 2)),
        st.booleans(),
    ),
    max_size=15,
)
PROPERTIES = [
    prop("p", "once[2:] {v: 1}", guards=frozenset({"/a"})),
    prop("q", "forall[x]. {v: *x} -> pre once {mode: *x}", guards=frozenset({"/a", "/u"})),
    prop("r", "{v: 1} since[:3] {mode: 1}", latch=True),
]


def run(session: Session, found: list[Happening], start: int) -> list[Judged]:
    """What two monitors say, from their attaching to their end."""
    judged = session.attach("m", [A, B, U, MODE], start) + session.attach("n", [A, B, U, MODE], start)
    feed, now = Feed(session), start
    for n, h in enumerate(found):
        now += h.gap
        judged += feed(
            h.stream,
            max(1, now - h.delay),
            {"v": h.value, "mode": h.value},
            monitor=h.monitor,
            arrived=now,
            lost=h.lost,
            ask=h.ask,
            source=str(n % 2),
        )
    judged += session.finish(now + 5)
    return judged + session.detach("m", now + 5) + session.detach("n", now + 5)


def undegraded(judged: Judged) -> Judged:
    return replace(judged, verdicts=tuple(replace(v, degraded=False) for v in judged.verdicts))


def check_rejudging(
    before: list[Happening],
    after: list[Happening],
    maker: Maker,
    ordering: dict[str, Any],
    properties: list[Property] = PROPERTIES,
) -> None:
    there = open_session(properties, attach={}, maker=maker, **ordering)
    back = open_session(properties, attach={}, maker=maker, **ordering)
    judged = run(there, before, 1_000)
    again = [again for j in judged if (again := back.rejudge(j.order, j.step, j.judged))]
    assert [undegraded(j) for j in again] == [undegraded(j) for j in judged]
    known = zip(degraded(again), degraded(judged), strict=True)
    assert all(was for now, was in known if now), "a loss is known from when it was told, and again once it is judged"
    assert back.now == max((j.judged for j in judged), default=0)
    assert run(back, after, there.now) == run(there, after, there.now)
    assert [j.counters for j in back.judges.values()] == [j.counters for j in there.judges.values()]


@settings(max_examples=150, deadline=None)
@given(
    before=happenings,
    after=happenings,
    by=st.sampled_from(("publication", "arrival", "both")),
    late=st.sampled_from(("judge", "skip")),
    capacity=st.sampled_from((3, 10_000)),
    max_delay=st.sampled_from((0, 20, 50)),
)
def test_judging_again_comes_back_to_where_it_was(
    before: list[Happening], after: list[Happening], by: str, late: str, capacity: int, max_delay: int
) -> None:
    """With engines that tell any difference in what they are told; and so does all that comes after."""
    ordering = {"by": by, "late": late, "capacity": capacity, "max_delay": max_delay, "max_skew": 30}
    check_rejudging(before, after, lambda _: Digest(), ordering)


OWING = [
    prop("e", "{v: 1} -> eventually[5ns:30ns] {v: 2}", time="seconds"),
    prop("a", '{v: 2} -> always[:3] not {v: "1"}', guards=frozenset({"/a"})),
    prop("n", "forall[x]. {v: *x} -> next next {v: 1} or always[:20ns] eventually[:10ns] {mode: *x}", time="seconds"),
    prop("u", "{v: 1} -> ({mode: *} until[:60ns] {v: 2})", time="seconds", latch=True),
]


@settings(max_examples=150, deadline=None)
@given(
    before=happenings,
    after=happenings,
    by=st.sampled_from(("publication", "arrival", "both")),
    late=st.sampled_from(("judge", "skip")),
    max_delay=st.sampled_from((0, 20, 50)),
)
def test_judging_again_what_must_follow(
    before: list[Happening], after: list[Happening], by: str, late: str, max_delay: int
) -> None:
    ordering = {"by": by, "late": late, "max_delay": max_delay, "max_skew": 30}
    check_rejudging(before, after, lambda p: NativeEngine(p.formula, p.time), ordering, OWING)


@settings(max_examples=10, deadline=None)
@given(before=happenings, after=happenings)
def test_judging_again_with_reelay(before: list[Happening], after: list[Happening]) -> None:
    check_rejudging(before, after, reelay, {"by": "both", "late": "skip", "max_skew": 30})


def test_a_loss_is_known_after_judging_again() -> None:
    there, back = (open_session(PROPERTIES, attach={}, by="arrival") for _ in range(2))
    judged = Feed(there)(A, 1, lost=2)
    assert [back.rejudge(j.order, j.step, j.judged) for j in judged] == judged
    assert degraded(Feed(back)(A, 2)) == [True] * len(PROPERTIES)


def test_a_late_event_moves_nothing_when_it_is_judged_again() -> None:
    there, back = (open_session(PROPERTIES, attach={"m": [A]}) for _ in range(2))
    feed = Feed(there)
    for judged in feed(A, 100) + feed(A, 90, arrived=101):
        back.rejudge(judged.order, judged.step, judged.judged)
    assert [j.step.late for j in Feed(back)(A, 95, arrived=102) + Feed(back)(A, 100, arrived=103)] == [True, False]
