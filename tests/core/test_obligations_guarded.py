"""Obligations that guard: what is denied of what they ask by `always`, also once that was decided."""

from __future__ import annotations

import json
from typing import Any

import pytest

from oracle_server.core.errors import EngineError
from oracle_server.core.session import Session
from oracle_server.core.spec import StreamSpec
from oracle_server.core.verdicts import Judged, Outcome
from tests.core.owing import about, native, opened, records
from tests.core.sessions import A, B, Feed, open_session, prop


def test_a_guard_denies_what_breaks_it() -> None:
    streams = [StreamSpec("/a", action="filter", on_deny="undo"), StreamSpec("/b")]
    lasts = prop("p", "{stop} -> always[:10] ({topic: /a} -> {v: 0})", guards=frozenset({"/a"}))
    session = opened(lasts, streams=streams)
    feed = Feed(session)
    judged = feed(A, 1, {"v": 3}, ask=True) + feed(B, 2, {"stop": True}) + feed(A, 3, {"v": 3}, ask=True)
    judged += feed(A, 4, {"v": 3}, ask=True) + feed(A, 5, {"v": 0}, ask=True)
    assert [j.decision.choice for j in judged if j.decision] == ["allow", "deny", "deny", "allow"]
    found = records(judged)
    assert [r["violation"] for r in found] == [False, False, True, True, False]
    assert [about(r) for r in found[2:4]] == [[(2, {})]] * 2
    assert found[-1]["pending"] == 1


STOPPED = "{stop} -> always[:10ns] ({topic: /a} -> {v: 0})"


def stopped(text: str = STOPPED, *, on_deny: Any = "keep", hold: bool = False, **more: Any) -> Session:
    held = frozenset({"v"} if hold else ())
    streams = [StreamSpec("/a", action="filter", on_deny=on_deny), StreamSpec("/b", hold=held)]
    return opened(prop("p", text, time="seconds", guards=frozenset({"/a"}), **more), streams=streams)


def chosen(judged: list[Judged]) -> list[str]:
    return [j.decision.choice for j in judged if j.decision]


@pytest.mark.parametrize("blame", ["any", "caused"])
@pytest.mark.parametrize("on_deny", ["keep", "undo"])
def test_a_guard_denies_all_that_breaks_it_until_its_bound_is_over_and_counts_what_it_asks_for_once(
    on_deny: Any, blame: Any
) -> None:
    session = stopped(on_deny=on_deny, blame=blame)
    feed = Feed(session)
    judged = feed(A, 1, {"v": 3}, ask=True) + feed(B, 2, {"stop": True})
    judged += [j for at in range(3, 12) for j in feed(A, at, {"v": 3 * (at != 7)}, ask=True)] + session.advance(12)
    judged += feed(A, 13, {"v": 3}, ask=True) + feed(A, 14, {"v": 3}, ask=True)
    assert chosen(judged) == ["allow", *["deny"] * 4, "allow", *["deny"] * 4, "allow", "allow"]
    counted = [r["violation"] for r in records(judged)]
    assert sum(counted) == (1 if on_deny == "keep" else 8), "each attempt is one"
    assert {j.decision.denied_by for j in judged if j.decision and j.decision.choice == "deny"} == {("p",)}


@pytest.mark.parametrize("on_deny", ["keep", "undo"])
def test_an_event_that_nobody_can_deny_does_not_end_what_a_guard_denies(on_deny: Any) -> None:
    session = stopped("{stop} -> always[:10ns] not {v > 0}", on_deny=on_deny)
    feed = Feed(session)
    judged = feed(B, 1, {"stop": True}) + feed(A, 2, {"v": 0}, ask=True) + feed(B, 3, {"v": 0.1})
    judged += feed(A, 4, {"v": 1}, ask=True) + feed(A, 5, {"v": 0}, ask=True) + feed(A, 6, {"v": 1}, ask=True)
    judged += feed(A, 12, {"v": 1}, ask=True)
    assert chosen(judged) == ["allow", "deny", "allow", "deny", "allow"]
    assert session.judges["arrival"].properties[0].violations == 1


@pytest.mark.parametrize(("blame", "choice"), [("any", "deny"), ("caused", "allow")])
def test_what_breaks_it_without_the_event_too_is_to_blame_as_ever(blame: Any, choice: str) -> None:
    session = stopped("{stop} -> always[:10ns] not {v > 0}", hold=True, blame=blame)
    feed = Feed(session)
    judged = feed(B, 1, {"stop": True, "v": 0}) + feed(B, 2, {"v": 0.1}) + feed(A, 3, {}, ask=True)
    assert chosen(judged) == [choice]


@pytest.mark.parametrize("restarted", [False, True])
@pytest.mark.parametrize(
    ("bound", "denied"),
    [(":200ns", [1260, 1360, 1400, 1401]), ("100ns:200ns", [1360, 1400, 1401]), ("180ns:200ns", [1400, 1401])],
)
def test_what_an_event_asks_for_that_is_older_than_a_tick_before_it_counts_from_the_ticks_time_on(
    bound: str, denied: list[int], restarted: bool
) -> None:
    def made() -> Session:
        streams = [StreamSpec("/a", action="filter"), StreamSpec("/b")]
        text = f"{{stop}} -> always[{bound}] ({{topic: /a}} -> {{v: 0}})"
        guard = prop("p", text, time="seconds", guards=frozenset({"/a"}))
        return open_session([guard], attach={"m": [A, B]}, streams=streams, maker=native, by="publication")

    session = made()
    feed = Feed(session)
    feed(B, 1000, {"stop": True})
    (_, tick) = session.advance(1310)
    feed(B, 1150, {"stop": True}, arrived=1310)
    session.advance(1361)
    assert (tick.step.event.stream.kind, tick.step.stamp) == ("tick", 1201)
    if restarted:
        saved, session = json.loads(json.dumps(session.snapshot())), made()
        session.restore(saved, 10)
        feed = Feed(session, feed.seqs)
    judged = [
        j for at in (1260, 1360, 1400, 1401, 1402) for j in feed(A, at, {"v": 3}, arrived=max(1361, at), ask=True)
    ]
    judged += session.advance(1600)
    assert [j.step.stamp for j in judged if j.decision and j.decision.choice == "deny"] == denied


def test_what_can_not_be_judged_asks_for_nothing_and_nothing_is_denied_for_it() -> None:
    streams = [StreamSpec("/a", action="filter"), StreamSpec("/b", signals={"near": "msg.near < 5"})]
    text = "{topic: /b} and not {near: true} -> always[:4] ({topic: /a} -> {v: 0})"
    feed = Feed(opened(prop("p", text, guards=frozenset({"/a"})), streams=streams))
    judged = feed(B, 1, {"near": "?"}) + feed(A, 2, {"v": 3}, ask=True) + feed(B, 3, {"near": 9})
    judged += feed(A, 4, {"v": 3}, ask=True) + feed(A, 5, {"v": 3}, ask=True)
    assert [r["outcome"] for r in records(judged)] == [
        "unknown",
        "currently_true",
        "currently_true",
        "currently_false",
        "currently_true",
    ]
    assert chosen(judged) == ["allow", "deny", "deny"]


def test_it_goes_on_denying_for_the_values_that_it_was_asked_for() -> None:
    session = stopped("forall[x]. {limit: *x} -> always[:10ns] ({topic: /a} -> {v <= *x})")
    feed = Feed(session)
    judged = feed(B, 1, {"limit": 5}) + feed(B, 6, {"limit": 8})
    for at, v in [(7, 6), (8, 7), (9, 9), (12, 7), (13, 9), (17, 9)]:
        judged += feed(A, at, {"v": v}, ask=True)
    assert chosen(judged) == ["deny", "deny", "deny", "allow", "deny", "allow"]
    assert session.judges["arrival"].properties[0].violations == 2


@pytest.mark.parametrize("way", ["snapshot", "records"])
def test_a_restarted_session_goes_on_denying(way: str) -> None:
    session, again = stopped(), stopped()
    feed = Feed(session)
    judged = feed(B, 1, {"stop": True}) + feed(A, 2, {"v": 3}, ask=True) + feed(A, 3, {"v": 3}, ask=True)
    if way == "snapshot":
        again.restore(json.loads(json.dumps(session.snapshot())), len(judged) + 1)
    else:
        assert [again.rejudge("arrival", j.step, j.judged) for j in judged] == judged
    for one in (session, again):
        feed = Feed(one)
        feed.seqs["m"] = iter(range(10, 99))  # type: ignore[assignment]
        assert chosen(feed(A, 4, {"v": 3}, ask=True) + feed(A, 5, {"v": 0}, ask=True)) == ["deny", "allow"]
        assert one.judges["arrival"].properties[0].violations == 1


def test_a_snapshot_of_before_tells_nothing_of_what_was_decided_and_is_not_used() -> None:
    session = stopped()
    Feed(session)(B, 1, {"stop": True})
    old: Any = session.snapshot()
    del old["judges"]["arrival"]["properties"][0]["engine"]["breaking"]
    with pytest.raises(EngineError, match="kept other things of obligations"):
        stopped().restore(old, 2)


def test_a_guard_to_blame_for_what_it_caused_is_judged_without_the_first_event_too() -> None:
    text = "not first -> {c: 2} until ((not {c: 1} -> true) or {b: false})"
    streams = [StreamSpec("/a", action="filter", on_deny="undo"), StreamSpec("/b")]
    session = opened(prop("p", text, guards=frozenset({"/a"}), blame="caused"), streams=streams)
    (judged,) = Feed(session)(A, 1, {"goal": "g1"}, ask=True)
    assert judged.verdicts[0].outcome is Outcome.CURRENTLY_TRUE
    assert session.judges["arrival"].properties[0].broken is None


def test_beside_an_attempt_that_others_deny_it_stays_false_for_good() -> None:
    streams = [StreamSpec("/a", action="filter", on_deny="undo"), StreamSpec("/b")]
    answered = prop("p", "{v: 1} -> next {v: 2}", latch=True)
    session = opened(answered, prop("q", "not {v: 9}", guards=frozenset({"/a"})), streams=streams)
    feed = Feed(session)
    rows = [row for n, v in enumerate((1, 3, 9, 1), 1) for row in feed(A, n, {"v": v}, ask=True)]
    assert [row.decision.choice for row in rows if row.decision] == ["allow", "allow", "deny", "allow"]
    assert [row.verdicts[0].outcome.value for row in rows] == ["currently_true", "false", "currently_false", "false"]


def test_beside_an_attempt_that_others_deny_what_can_not_be_judged_is_unknown() -> None:
    signals = {"v": "msg.v", "w": "msg.w"}
    streams = [StreamSpec("/a", action="filter", on_deny="undo", signals=signals), StreamSpec("/b", signals={})]
    both = prop("p", "{v: *} -> (next {v: 2}) and eventually[:5] {w: 1}")
    session = opened(both, prop("q", "not {v: 9}", guards=frozenset({"/a"})), streams=streams)
    feed = Feed(session)
    rows = feed(A, 1, {"v": 1, "w": 0}, ask=True) + feed(A, 2, {"v": 9, "w": {}}, ask=True)
    assert [row.verdicts[0].outcome.value for row in rows] == ["currently_true", "unknown"]
