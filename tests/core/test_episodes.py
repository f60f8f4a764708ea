"""Episodes, against a plain reading of the rows: live, judged again, from a snapshot, and where late events revise."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.episode import Episode, Following, Worst, loaded, saved
from oracle_server.core.judging.following import Said, follow_said
from oracle_server.core.session import Session
from oracle_server.core.spec import Property, StreamSpec
from oracle_server.core.verdicts import NEGATIVE, Judged, Outcome
from tests.core.sessions import A, Digest, Feed, Maker, Recorder, open_session, prop
from tests.core.test_session_again import OWING, PROPERTIES, Happening, happenings, run
from tests.core.test_snapshots import TIMED, native
from tests.episodes import Kept, Line, expected, lines_of, told

SECOND = 10**9
T, F, GOOD, BAD, U_ = (
    Outcome.CURRENTLY_TRUE, Outcome.CURRENTLY_FALSE, Outcome.TRUE, Outcome.FALSE, Outcome.UNKNOWN,
)  # fmt: skip


def episodes_of(lines: list[Line], gap: int) -> list[Episode]:
    """What following the lines one by one gives."""
    known, kept = Following(), {}
    for line in lines:
        said = Said(line.outcome, line.violations)
        before = Following(known.time, known.episodes or (None,))
        known, changes = follow_said(before, gap, line.time, line.n, [(0, said)], instant=line.instant)
        for change in changes:
            kept[change.episode.first] = change.episode
    return [*kept.values()]


@settings(max_examples=300, deadline=None)
@given(
    rows=st.lists(st.tuples(st.integers(0, 4), st.sampled_from((T, F, U_, BAD, GOOD)), st.booleans()), max_size=30),
    gap=st.sampled_from((0, 1, 3, 6)),
)
def test_rows_one_by_one_give_what_all_of_them_give(rows: list[tuple[int, Outcome, bool]], gap: int) -> None:
    lines, time, negative = [], 10, False
    for n, (later, outcome, instant) in enumerate(rows, 1):
        time += later
        violates = outcome in NEGATIVE and not negative
        if outcome is not U_ and not instant:
            negative = outcome in NEGATIVE
        lines.append(Line(n, time, outcome, int(violates), instant))
    assert told(episodes_of(lines, gap)) == told(expected(lines, gap))


def judged_of(outcomes: str, times: list[int], gap: int = 10) -> list[tuple[int, int, int, int, bool, int]]:
    letters = {"t": T, "f": F, "u": U_, "F": BAD, "T": GOOD}
    before = [" ", *outcomes]
    lines = [
        Line(n, time, letters[letter], int(letter in "fF" and before[n - 1] not in "fF"), instant=False)
        for n, (letter, time) in enumerate(zip(outcomes, times, strict=True), 1)
    ]
    assert told(episodes_of(lines, gap)) == told(expected(lines, gap))
    return [(e.first, e.began, e.last, e.until, e.open, e.count) for e in episodes_of(lines, gap)]


def test_violations_less_than_the_gap_apart_are_one_episode() -> None:
    assert judged_of("ftft", [0, 5, 9, 20]) == [(1, 0, 3, 9, False, 2)]


def test_a_violation_at_the_gap_begins_another_one() -> None:
    assert judged_of("ftft", [0, 5, 10, 20]) == [(1, 0, 1, 0, False, 1), (3, 10, 3, 10, False, 1)]


def test_what_stays_violated_is_one_episode_however_long_it_takes() -> None:
    assert judged_of("fff", [0, 1_000, 5_000])[0][:2] == (1, 0)
    assert judged_of("ffft", [0, 1_000, 5_000, 5_001]) == [(1, 0, 3, 5_000, False, 1)]


def test_what_is_unknown_neither_ends_nor_begins_one() -> None:
    assert judged_of("fuut", [0, 5, 900, 901]) == [(1, 0, 1, 0, False, 1)]
    ((first, began, _, _, is_open, _),) = judged_of("fuu", [0, 5, 900])
    assert (first, began, is_open) == (1, 0, True), "it is not known to hold"


def _session(says: list[Outcome]) -> Session:
    return open_session([prop("p", "{a}")], attach={"m": [A]}, maker=lambda _: Recorder(says), by="arrival")


def test_a_row_without_violations_has_no_cost() -> None:
    feed = Feed(_session([T, T, U_, T]))
    rows = [row for at in (1, 2, 3, 4) for row in feed(A, at)]
    assert [row.episodes for row in rows] == [(), (), (), ()]


def test_only_rows_that_open_join_or_end_one_tell_of_it() -> None:
    feed = Feed(_session([T, F, F, F, T, T, F, T, T, T]))
    times = [1, 2, 3, 4, 5, 6, 7, 8, 9, 7 + SECOND]
    kinds = [[change.kind for change in row.episodes] for at in times for row in feed(A, at * 1)]
    assert kinds == [[], ["begins"], [], [], ["stops"], [], ["joins"], ["stops"], [], ["ends"]]


def _texts(judged: list[Judged]) -> list[tuple[str, Worst | None]]:
    return [(change.kind, change.episode.worst) for row in judged for change in row.episodes]


def test_the_worst_is_the_value_furthest_from_its_bound() -> None:
    session = open_session([prop("p", "{v <= 5}")], attach={"m": [A]}, maker=native, by="arrival")
    feed = Feed(session)
    judged = [row for at, v in enumerate((1, 7, 2, 9.5, 3, 6), 1) for row in feed(A, at, {"v": v})]
    values = [worst.value for _, worst in _texts(judged) if worst is not None]
    assert values == [7, 7, 9.5, 9.5, 9.5]
    assert judged[1].episodes[0].episode.worst == Worst(signal="v", op="<=", bound=5, value=7)


def test_the_worst_is_that_of_the_whole_time_for_which_it_is_violated() -> None:
    """It is told of while it grows, by a tenth at a time, and as it is in the end."""
    session = open_session([prop("p", "{v <= 5}")], attach={"m": [A]}, maker=native, by="arrival")
    feed = Feed(session)
    values = (6, 6.01, 9, 8.99, 50, 50.1, 4)
    judged = [row for at, v in enumerate(values, 1) for row in feed(A, at, {"v": v})]
    told = [(kind, worst.value) for kind, worst in _texts(judged) if worst is not None]
    assert told == [("begins", 6), ("joins", 9), ("joins", 50), ("stops", 50.1)]


@pytest.mark.parametrize("latch", [True, False])
def test_what_is_allowed_is_not_the_worst_of_what_was_latched(latch: bool) -> None:
    properties = [prop("p", "{auto: true} -> {v <= 5}", latch=latch)]
    feed = Feed(open_session(properties, attach={"m": [A]}, maker=native, by="arrival"))
    values = ((True, 6), (False, 99), (True, 40), (True, 1))
    judged = [row for at, (auto, v) in enumerate(values, 1) for row in feed(A, at, {"auto": auto, "v": v})]
    assert _texts(judged)[-1][1] == Worst(signal="v", op="<=", bound=5, value=40)


@pytest.mark.parametrize(
    ("formula", "values", "worst"),
    [
        ("not {v > 5}", [{"v": 7}, {"v": 1}, {"v": 9.5}, {"v": 1}, {"v": 6}], ("v", "<=", 5, 9.5, None)),
        ("not {v <= -2}", [{"v": -3}, {"v": 1}, {"v": -2}], ("v", ">", -2, -3, None)),
        ("not {on, v > 5}", [{"on": True, "v": 7}, {"on": False, "v": 99}], ("v", "<=", 5, 7, None)),
        ("{on} -> not {v > 5}", [{"on": True, "v": 7}], ("v", "<=", 5, 7, None)),
        ("{w > 1} -> {v <= 5}", [{"w": 99, "v": 7}], ("v", "<=", 5, 7, None)),
        (
            "not {v > limit}",
            [{"v": 7, "limit": 4}, {"v": 1, "limit": 4}, {"v": 9, "limit": 8}],
            ("v", "<=", 4, 7, "limit"),
        ),
        ("{v <= 5} and not {w > 1}", [{"v": 1, "w": 3}], ("w", "<=", 1, 3, None)),
        ("not {v > 5} and not {v < 1}", [{"v": 7}], ("v", "<=", 5, 7, None)),
        ("not {on}", [{"on": True}], None),
        ("not (once {v > 5})", [{"v": 7}, {"v": 1}, {"v": 8}], ("v", "<=", 5, 8, None)),
        ("historically ({on} -> {v <= 5})", [{"on": True, "v": 6}, {"v": 99}], ("v", "<=", 5, 6, None)),
    ],
)
def test_the_worst_of_what_must_not_be_is_the_value_furthest_beyond_it(
    formula: str, values: list[dict[str, Any]], worst: tuple[Any, ...] | None
) -> None:
    session = open_session([prop("p", formula)], attach={"m": [A]}, maker=native, by="arrival")
    feed = Feed(session)
    judged = [row for at, data in enumerate(values, 1) for row in feed(A, at, data)]
    found = _texts(judged)[-1][1]
    if worst is None:
        assert found is None
    else:
        signal, op, bound, value, than = worst
        assert found == Worst(signal=signal, op=op, bound=bound, value=value, than=than)


def kept(rows: list[Judged]) -> Kept:
    found = Kept()
    found.take(rows)
    return found


def opened(properties: list[Property], maker: Maker, **more: Any) -> Session:
    return open_session(properties, attach={}, maker=maker, **more)


def check(rows: list[Judged], session: Session, found: Kept) -> int:
    """Compare with the plain reading; returns how many episodes there are."""
    spec, count = session.plan.spec, 0
    for index in range(len(spec.properties)):
        wanted = [
            episode
            for order in session.judges
            for episode in expected(lines_of([r for r in rows if r.order == order], spec, index), spec.gap)
        ]
        have = found.of(index)
        assert told(have) == told(sorted(wanted, key=lambda episode: (episode.began, episode.first)))
        count += len(have)
    return count


FILTERED = (
    StreamSpec("/a", action="filter", on_deny="undo"),
    StreamSpec("/b"),
    StreamSpec("/u", ordered=False),
    StreamSpec("/mode", hold=frozenset({"mode"})),
)
BOUNDED = [
    prop("within", "{v <= 1}"),
    prop("ever", "historically ({mode: 1} -> {v < 2})"),
    prop("latched", "not {v > 1}", latch=True),
]
KINDS: dict[str, tuple[Maker, list[Property], dict[str, Any]]] = {
    "any outcomes": (lambda _: Digest(), PROPERTIES, {}),
    "native": (native, TIMED, {}),
    "bounds": (native, BOUNDED, {}),
    "taken back": (native, TIMED, {"streams": FILTERED}),
    "owing": (native, OWING, {}),
    "owing, taken back": (native, OWING, {"streams": FILTERED}),
}


@settings(max_examples=120, deadline=None)
@given(
    events=happenings,
    by=st.sampled_from(("publication", "arrival", "both")),
    late=st.sampled_from(("judge", "skip")),
    max_delay=st.sampled_from((0, 20, 50)),
    kind=st.sampled_from(sorted(KINDS)),
    gap=st.sampled_from((0, 15, 60)),
)
def test_live_judging_and_judging_again_give_the_same(
    events: list[Happening], by: str, late: str, max_delay: int, kind: str, gap: int
) -> None:
    maker, properties, more = KINDS[kind]
    ordering = {"by": by, "late": late, "max_delay": max_delay, "max_skew": 30}
    if more and by == "both":
        ordering["by"] = "arrival"  # nothing is taken back in two orders
    there, back = (opened(properties, maker, gap=gap, **{**ordering, **more}) for _ in "ab")
    rows = run(there, events, 1_000)
    check(rows, there, kept(rows))
    again = [again for row in rows if (again := back.rejudge(row.order, row.step, row.judged))]
    assert [row.episodes for row in again] == [row.episodes for row in rows]


def test_a_snapshot_keeps_whole_numbers_whole() -> None:
    worst = Worst(signal="v", op="<=", bound=5, value=2**53 + 1)
    known = Following(4, (Episode(1, 2, 3, 4, True, False, 1, worst),))
    (back,) = loaded(json.loads(json.dumps(saved(known)))).episodes
    assert back is not None
    assert repr(back.worst) == repr(worst)


@settings(max_examples=80, deadline=None)
@given(
    before=happenings,
    after=happenings,
    by=st.sampled_from(("publication", "arrival")),
    kind=st.sampled_from(("native", "taken back", "owing")),
)
def test_a_snapshot_has_the_episodes_that_may_go_on(
    before: list[Happening], after: list[Happening], by: str, kind: str
) -> None:
    maker, properties, more = KINDS[kind]
    ordering = {"by": by, "max_delay": 20, "max_skew": 30, "gap": 40}
    there, back = (opened(properties, maker, **{**ordering, **more}) for _ in "ab")
    first = run(there, before, 1_000)
    back.restore(json.loads(json.dumps(there.snapshot())), len(first) * len(properties) + 1)
    rows = run(back, after, there.now)
    check([*first, *rows], there, kept([*first, *rows]))
