"""Obligations in a session: violations, what they are about, ticks, failures, undo, latches, restarts and the end."""

from __future__ import annotations

import json
from typing import Any

import pytest

from oracle_server.core.formula.tree import Scalar
from oracle_server.core.session import Session
from oracle_server.core.spec import Property, StreamSpec
from oracle_server.core.verdicts import Judged, Outcome
from oracle_server.engines.native import triggers
from oracle_server.engines.native.keys import Key
from oracle_server.engines.native.obligations import Obligations
from tests.core.owing import about, native, opened, records, timed
from tests.core.sessions import A, B, Feed, open_session, prop


def test_each_trigger_that_was_not_answered_is_a_violation_and_none_is_masked() -> None:
    session = opened(timed())
    feed = Feed(session)
    judged = feed(A, 1, {"goal": "g1"}) + feed(A, 2, {"goal": "g2"}) + feed(A, 3, {"goal": "g1"})
    assert [r["pending"] for r in records(judged)] == [1, 2, 3]
    assert {r["outcome"] for r in records(judged)} == {"currently_true"}
    judged = session.advance(100)
    found = records(judged)
    assert [(r["kind"], r["stamp"], r["outcome"], about(r), r["pending"]) for r in found] == [
        ("tick", 12, "currently_false", [(1, {"g": "g1"})], 2),
        ("tick", 13, "currently_false", [(2, {"g": "g2"})], 1),
        ("tick", 14, "currently_false", [(3, {"g": "g1"})], 0),
    ]
    (state,) = session.judges["arrival"].properties
    assert (state.violations, state.first_violation, state.first_violation_at) == (3, 4, 12)
    assert found[0]["about"][0] == {
        "step": 1, "stream": "/a", "kind": "topic", "monitor": "m", "seq": 1, "stamp": 1,
        "signals": {"goal": "g1", "topic": "/a", "kind": "topic", "monitor": "m"}, "values": {"g": "g1"},
    }  # fmt: skip
    assert "about" not in found[0]["explanation"]
    assert session.next_deadline is None


def test_an_answer_meets_all_that_wait_for_it_and_the_record_tells_them_apart() -> None:
    session = opened(prop("p", "forall[g]. {goal: *g} -> {held} until[:5] {done: *g}"))
    feed = Feed(session)
    judged = feed(A, 1, {"goal": 1, "held": True}) + feed(A, 2, {"goal": 1, "held": True})
    judged += feed(A, 3, {"goal": 2, "held": True}) + feed(B, 4, {"done": 1}) + feed(B, 5, {})
    found = records(judged)
    assert [r["outcome"] for r in found][:3] == ["currently_true"] * 3
    assert [about(r) for r in found[3:]] == [[(3, {"g": 2})], []]
    assert found[3]["violation"]
    assert found[4]["outcome"] == "currently_true"


def test_a_record_has_at_most_a_hundred_of_them_and_their_count() -> None:
    session = opened(prop("p", "{a} -> always[:1000] not {b}"))
    feed = Feed(session)
    for n in range(1, 151):
        feed(A, n, {"a": True})
    (found,) = records(feed(B, 200, {"b": True}))
    assert [len(found["about"]), found["about_count"], found["pending"]] == [100, 150, 0]
    assert [each["step"] for each in found["about"]] == list(range(1, 101))
    assert session.judges["arrival"].properties[0].violations == 150


def test_of_those_that_are_not_told_the_values_are_not_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """They would take longer than to decide them, while all sessions wait."""
    read, values = list[Key](), Obligations.values

    def noted(owed: Obligations, key: Key) -> dict[str, Scalar]:
        read.append(key)
        return values(owed, key)

    monkeypatch.setattr(Obligations, "values", noted)
    session = opened(prop("p", "forall[x]. {v: *x} -> always[:10000] not {b}"))
    feed = Feed(session)
    for n in range(1, 1001):
        feed(A, n, {"v": n})
    (found,) = records(feed(B, 2000, {"b": True}))
    assert [each["values"]["x"] for each in found["about"]] == list(range(1, 101))
    assert (found["about_count"], found["explanation"]["other_values"]) == (1000, 999)
    assert len(read) < 2 * len(found["about"])


def test_what_can_not_be_judged_is_lost_and_no_violation() -> None:
    streams = [StreamSpec("/a"), StreamSpec("/b", signals={"done": "msg.done", "v": "1 / msg.v"})]
    session = opened(prop("p", "{goal} -> eventually[:2] {done, v: 1}"), streams=streams)
    feed = Feed(session)
    judged = feed(A, 1, {"goal": True}) + feed(B, 2, {"done": True, "v": 0}) + feed(A, 3) + feed(A, 4)
    found = records(judged)
    assert [r["outcome"] for r in found] == ["currently_true", "unknown", "currently_true", "currently_true"]
    assert [r["degraded"] for r in found] == [False, False, True, True]
    assert [r["pending"] for r in found] == [1, 1, 0, 0]
    (state,) = session.judges["arrival"].properties
    assert (state.violations, state.failures) == (0, 2)


def test_a_step_that_decides_one_false_is_negative_though_it_failed() -> None:
    streams = [StreamSpec("/a"), StreamSpec("/b", signals={"stop": "msg.stop", "v": "1 / msg.v"})]
    session = opened(prop("p", "{goal} -> always[:5] (not {stop} or {v: 1})"), streams=streams)
    feed = Feed(session)
    (found,) = records(feed(A, 1, {"goal": True}) + feed(B, 2, {"stop": True, "v": 0}))[1:]
    assert found["outcome"] == "unknown", "the operand reads what failed"
    session = opened(prop("p", "{goal} -> next {a} and always[:5] not {v: 7}"), streams=streams)
    feed = Feed(session)
    (found,) = records(feed(A, 1, {"goal": True}) + feed(B, 2, {"stop": True, "v": 0}))[1:]
    assert found["outcome"] == "currently_false"
    assert session.judges["arrival"].properties[0].failures == 1


@pytest.mark.parametrize(
    ("goal", "step"),
    [
        ("{v > lim, ok}", {"v": 1, "lim": 3}),
        ("{v > lim, ok}", {"v": "fast", "lim": 3}),
        ("{v < lim}", {"v": "fast"}),
        ("{v: *x, lim: *x, ok}", {"v": 1, "lim": 3}),
        ("(exists[y]. {v: *y, lim: *y, ok})", {"v": 1, "lim": 3}),
    ],
)
def test_what_failed_is_no_excuse_where_the_rest_already_denies_it(goal: str, step: dict[str, Any]) -> None:
    names = ("v", "lim", "ok")
    streams = [StreamSpec("/a"), StreamSpec("/b", signals={name: f"msg.{name}" for name in names})]
    session = opened(prop("p", f"forall[x]. {{g: *x}} -> eventually[:1] {goal}"), streams=streams)
    feed = Feed(session)
    feed(A, 1, {"g": 1})
    (found,) = records(feed(B, 2, {name: {} for name in names} | step))
    assert about(found) == [(1, {"x": 1})]
    (state,) = session.judges["arrival"].properties
    assert (state.pending, state.violations) == (0, 1)


def test_a_trigger_that_can_not_be_judged_asks_for_nothing() -> None:
    streams = [StreamSpec("/a", signals={"v": "1 / msg.v"}), StreamSpec("/b")]
    session = opened(prop("p", "{topic: /a} and not {v > 5} -> next {ok}"), streams=streams)
    feed = Feed(session)
    found = records(feed(A, 1, {"v": 0}) + feed(B, 2, {}))
    assert [(r["outcome"], r["pending"]) for r in found] == [("unknown", 0), ("currently_true", 0)]


def test_a_latch_ends_it() -> None:
    session = opened(timed(latch=True))
    feed = Feed(session)
    feed(A, 1, {"goal": 1})
    feed(A, 2, {"goal": 2})
    judged = session.advance(50) + feed(A, 60, {"goal": 3})
    found = records(judged)
    assert [(r["outcome"], r["violation"], r["pending"]) for r in found] == [("false", True, 0), ("false", False, 0)]
    assert session.judges["arrival"].properties[0].violations == 1
    assert session.next_deadline is None


@pytest.mark.parametrize("answered", [True, False])
def test_what_a_denied_event_opened_or_met_comes_back(answered: bool) -> None:
    streams = [StreamSpec("/a", action="filter", on_deny="undo"), StreamSpec("/b")]
    guard = prop("guard", "{topic: /a} -> {ok}", guards=frozenset({"/a"}))
    session = opened(prop("p", "forall[g]. {goal: *g} -> eventually[:3] {done: *g}"), guard, streams=streams)
    feed = Feed(session)
    feed(A, 1, {"goal": 1, "ok": True}, ask=True)
    denied = records(feed(A, 2, {"goal": 2, "done": 1, "ok": False}, ask=True))
    assert [(r["property"], r["outcome"], r["step"]) for r in denied] == [
        ("p", "currently_true", None), ("guard", "currently_false", None)
    ]  # fmt: skip
    assert session.judges["arrival"].properties[0].pending == 1
    judged = feed(B, 3, {"done": 1} if answered else {}) + feed(B, 4, {}) + feed(B, 5, {}) + feed(B, 6, {})
    failed = [about(r) for r in records(judged) if r["violation"]]
    assert failed == ([] if answered else [[(1, {"g": 1})]])


def test_what_only_an_attempt_has_reached_is_counted_once_it_is_reached() -> None:
    streams = [StreamSpec("/a", action="filter", on_deny="undo"), StreamSpec("/b")]
    guard = prop("guard", "{topic: /a} -> {ok}", guards=frozenset({"/a"}))
    session = opened(prop("p", "{goal} -> eventually[:1] {done}"), guard, streams=streams)
    feed = Feed(session)
    feed(B, 1, {"goal": True})
    (attempt, _) = records(feed(A, 2, {"ok": False}, ask=True))
    assert (attempt["outcome"], attempt["violation"], attempt["step"]) == ("currently_true", False, None)
    assert session.judges["arrival"].properties[0].violations == 0
    (reached, _) = records(feed(B, 3, {}))
    assert (reached["outcome"], about(reached)) == ("currently_false", [(1, {})])
    assert session.judges["arrival"].properties[0].violations == 1


@pytest.mark.parametrize("at_end", ["ignore", "violated"])
def test_what_is_open_at_the_end(at_end: Any) -> None:
    session = opened(
        prop("p", "{goal} -> eventually {done}", at_end=at_end), prop("q", "{goal} -> always {ok: *}", at_end=at_end)
    )
    feed = Feed(session)
    feed(A, 1, {"goal": True, "ok": 1})
    found = records(session.finish(9) + session.end(9))
    if at_end == "ignore":
        assert found == []
        assert [s.pending for s in session.judges["arrival"].properties] == [1, 1]
    else:
        assert [(r["kind"], r["outcome"], about(r)) for r in found] == [
            ("tick", "currently_false", [(1, {})]), ("tick", "currently_true", [])
        ]  # fmt: skip
        assert "when the session ended" in found[0]["explanation"]["text"]
        assert [s.pending for s in session.judges["arrival"].properties] == [0, 0]


def test_a_session_goes_on_from_its_snapshot_and_from_its_records() -> None:
    session, again = opened(timed()), opened(timed())
    feed = Feed(session)
    judged = feed(A, 1, {"goal": 1}) + feed(A, 3, {"goal": 2}) + feed(B, 4, {"done": 2})
    judged += session.advance(15)
    for item in judged:
        got = again.rejudge("arrival", item.step, item.judged)
        assert got is not None
        assert got.verdicts == item.verdicts
    other = opened(timed())
    other.restore(json.loads(json.dumps(session.snapshot())), len(judged) + 1)
    for one in (session, again, other):
        assert [s.violations for s in one.judges["arrival"].properties] == [1]
        feed = Feed(one)
        feed.seqs["m"] = iter(range(10, 99))  # type: ignore[assignment]
        found = records(feed(A, 20, {"goal": 3}) + one.advance(40))
        assert [(r["n"], r["outcome"], about(r)) for r in found] == [
            (5, "currently_true", []), (6, "currently_false", [(4, {"g": 3})])
        ]  # fmt: skip


def test_too_many_open_ones_end_it() -> None:
    session = opened(prop("p", "{a} -> eventually {b}"))
    feed = Feed(session)
    feed(A, 1, {"a": True})
    (state,) = session.judges["arrival"].properties
    for n in range(2, 100_001):
        state.engine.step(n, [(), None])
    assert state.pending == 100_000
    (found,) = records(feed(A, 1, {"a": True}))
    assert found["outcome"] == Outcome.UNKNOWN
    assert state.broken is not None
    assert "more than 100,000 of its obligations are open at once" in state.broken
    assert state.pending is None


TOLD = [StreamSpec("/a", signals={name: f"msg.{name}" for name in ("goal", "map", "name")}), StreamSpec("/b")]


def restored(session: Session, *properties: Property) -> Session:
    data = json.loads(json.dumps(session.snapshot()))
    again = opened(*properties, streams=TOLD)
    again.restore(data, 1)
    return again


def kept(judged: list[Judged], name: str) -> list[Any]:
    """A signal of the triggers of what was not answered, None where it is not told any more."""
    return [each["signals"].get(name) for found in records(judged) for each in found["about"]]


def test_what_is_open_keeps_no_long_text_of_its_trigger() -> None:
    """Thousands of messages with a map in each would take all memory, and each snapshot."""
    session = opened(timed(), streams=TOLD)
    feed = Feed(session)
    for n in range(1, 4):
        feed(A, n, {"goal": n, "map": f"{n}" * 2_000, "name": f"n{n}"})
    assert "1" * 2_000 not in json.dumps(session.judges["arrival"].properties[0].snapshot())
    for one in (session, restored(session, timed())):
        judged = one.advance(100)
        assert kept(judged, "map")[0].startswith("1" * 64 + "… (2000 characters, SHA-256 ")
        assert kept(judged, "name") == ["n1", "n2", "n3"]


def test_signals_of_triggers_for_which_there_is_no_room_are_not_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(triggers, "ROOM", 300)
    session = opened(timed(), streams=TOLD)
    feed = Feed(session)
    for n in range(1, 6):
        feed(A, n, {"goal": n, "name": "x" * 90})
    for one in (session, restored(session, timed())):
        judged = one.advance(100)
        assert [name is not None for name in kept(judged, "name")] == [True, True, False, False, False]
        assert [about(r) for r in records(judged)] == [[(n, {"g": n})] for n in range(1, 6)]
    feed(A, 101, {"goal": 1, "name": "y" * 90})
    assert kept(session.advance(200), "name") == ["y" * 90], "there is room again"


def test_a_step_that_comes_after_its_deadline_was_judged_changes_nothing_and_is_no_second_violation() -> None:
    streams = [StreamSpec("/a"), StreamSpec("/b", ordered=False)]
    session = open_session([timed()], attach={"m": [A, B]}, streams=streams, maker=native)
    feed = Feed(session)
    judged = feed(A, 1, {"goal": 1}) + session.clock("m", [], 5) + session.advance(100)
    judged += feed(B, 9, {"done": 1}, arrived=101) + feed(B, 10, {}, arrived=102) + session.advance(300)
    assert [(r["kind"], r["violation"]) for r in records(judged)] == [
        ("topic", False), ("tick", True), ("topic", False), ("topic", False)
    ]  # fmt: skip
    assert session.judges["publication"].properties[0].violations == 1


def told(session: Session, judged: list[Judged]) -> str:
    (text,) = [r["explanation"]["text"] for r in records(judged) if r["violation"]]
    return str(text)


SECOND = 10**9
WITHIN = "forall[g]. {goal: *g} -> eventually[:10s] {done: *g}"


@pytest.mark.parametrize(
    ("formula", "time", "steps", "says"),
    [
        (
            "forall[g]. {goal: *g} -> eventually[:2] {done: *g}", "steps", [{"goal": "a"}, {"done": "b"}, {}],
            'p does not hold at step 3 (3.000 s), /a (topic 3 of m): for g = "a": eventually[:2] {done: "a"}: asked '
            "for at step 1 (1.000 s), /a (topic 1 of m); at none of steps 1\u20133",
        ),
        (
            WITHIN, "seconds", [{"goal": 1}, {}, {}],
            "p does not hold when a deadline ran out at 11.000000001 s: for g = 1: eventually[:10s] {done: 1}: asked "
            "for at step 1 (1.000 s), /a (topic 1 of m); at none of 3 steps until 11.000 s",
        ),
        (
            "{stop} -> always[:5] {v: 0}", "steps", [{"stop": True, "v": 0}, {"v": 2}],
            "it fails at this step; {v: 0}: v = 2, wanted 0, at step 2 (2.000 s)",
        ),
        (
            "{stop} -> next {v: 0}", "steps", [{"stop": True, "v": 0}, {"v": 2}],
            "it fails at this step, the one after; {v: 0}: v = 2, wanted 0, at step 2 (2.000 s)",
        ),
        (
            "{a} -> {b} until[:5] {c}", "steps", [{"a": True, "b": True}, {}],
            "its left side fails at this step; {b}: `b` is absent, at step 2 (2.000 s)",
        ),
        (
            "{a} -> {b} until[:1] {c}", "steps", [{"a": True, "b": True}, {"b": True}],
            "asked for at step 1 (1.000 s), /a (topic 1 of m); at none of steps 1\u20132",
        ),
        (
            "{a} -> eventually[:2s] ({b} and eventually[:3s] {c})", "seconds", [{"a": True}, {"b": True}, *[{}] * 4],
            "asked for at step 1 (1.000 s), /a (topic 1 of m); at none of the steps until 3.000 s; "
            "{b}: held at step 2 (2.000 s), /a (topic 2 of m), 3.000000001s ago; eventually[:3s] {c}: asked for at "
            "step 2 (2.000 s), /a (topic 2 of m), 3.000000001s ago; at none of 4 steps within 3s",
        ),
        (
            "{a} -> eventually[:2s] ({b} and eventually[:3s] {c})", "seconds", [{"a": True}, *[{}] * 4],
            "at none of the steps until 3.000 s; {b}: held at none of 3 steps between",
        ),
        (
            "{a} -> eventually[:2] (eventually[:1] {c} and {b: *})", "steps",
            [{"a": True}, {"b": 2}, {"b": 3}, {}, {"c": True}],
            "at none of steps 1\u20133; {b: *}: held at each of steps 2\u20133; "
            "eventually[:1] {c}: asked for at step 3 (3.000 s); none in steps 3\u20134",
        ),
        (
            "{a} -> eventually[:1] ({b} and eventually[:1] ({c} and eventually[:1] {d}))", "steps",
            [{"a": True}, {"b": True}, {"c": True}, {}, {}],
            "{c}: held at step 3 (3.000 s); eventually[:1] {d}: asked for at step 3 (3.000 s); none in steps 3\u20134",
        ),
        (
            "{a} -> next next (next {b} and {c})", "steps", [{"a": True}, {}, {}],
            "it can't hold any more; {c}: `c` is absent, at step 3 (3.000 s)",
        ),
        (
            "{a} -> eventually[:1s] {b} and eventually[:9s] {c}", "seconds", [{"a": True}, {}, {}],
            "it can't hold any more; eventually[:1s] {b}: asked for at step 1 (1.000 s), /a (topic 1 of m), "
            "1.000000001s ago; at none of 2 steps within 1s",
        ),
        (
            "{a} -> eventually[:3] {b} and always[:3] {c}", "steps", [{"a": True, "c": True}, {}],
            "it can't hold any more; {c}: `c` is absent, at step 2 (2.000 s)",
        ),
        (
            "{a} -> eventually[:1] {b} or {c}", "steps", [{"a": True}, {}],
            "it can't hold any more; eventually[:1] {b}: asked for at step 1 (1.000 s); none in steps 1\u20132; "
            "{c}: `c` is absent, at step 1 (1.000 s)",
        ),
    ],
)  # fmt: skip
def test_a_violation_says_who_asked_for_what_and_how_many_steps_were_looked_at(
    formula: str, time: Any, steps: list[dict[str, Any]], says: str
) -> None:
    session = opened(prop("p", formula, time=time))
    feed = Feed(session)
    judged = [j for n, data in enumerate(steps, 1) for j in feed(A, n * SECOND, data)]
    judged += session.advance(100 * SECOND) if time == "seconds" else []
    assert says in told(session, judged)


def test_an_explanation_tells_of_three_and_counts_the_others() -> None:
    session = opened(prop("p", "{a} -> eventually[:100] {b}", at_end="violated"))
    feed = Feed(session)
    for n in range(1, 8):
        feed(A, n, {"a": True})
    (found,) = records(session.finish(9) + session.end(9))
    assert [reason["holds"] for reason in found["explanation"]["reasons"]] == [False] * 3
    assert (found["explanation"]["other_values"], found["about_count"]) == (6, 7)
