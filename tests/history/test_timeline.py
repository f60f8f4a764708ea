"""What is told by time is what the rows come to, whatever is written, revised, deleted, and however it goes on."""

from __future__ import annotations

import json
import random
import sqlite3
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.revisions import Change, Standing
from oracle_server.core.verdicts import Outcome
from oracle_server.history import blocks, columns
from oracle_server.history.blocks import SIZE
from oracle_server.history.columns import grid
from oracle_server.history.timeline import MOST_NEWS, Question
from tests.history.blocked import OUTCOMES, SIGNALS, Session, check, counted, some
from tests.history.making import explanation


def window(rng: random.Random, session: Session) -> Question:
    """A question for a window that may lie anywhere, be of any width, or be open at its ends."""
    times = [each.step.time for each in session.steps] or [0]
    ends = sorted(rng.choice(times) + rng.randrange(-5000, 5000) for _ in range(2))
    since, until = (max(0, end) for end in ends)
    return Question(
        since if rng.random() < 0.7 else None,
        until if rng.random() < 0.7 else None,
        rng.choice([1, 2, 3, 7, 30, 200, 2000]),
        signals=SIGNALS,
    )


def ask(rng: random.Random, session: Session, times: int) -> None:
    for _ in range(times):
        check(session.ask(window(rng, session)), session.steps, session.decides)


def go_on(rng: random.Random, session: Session, most: int, *, both: bool = False) -> None:
    """Write some more steps, as one commit or several."""
    at = max((each.step.time for each in session.steps), default=10**6)
    for _ in range(rng.randrange(1, 4)):
        steps = some(rng, session.last + 1, rng.randrange(most), at, both=both)
        if rng.random() < 0.2:
            session.add(steps, kept=False)
        session.add(steps)
        at = max((each.step.time for each in steps), default=at)


@given(seed=st.integers(0, 2**32))
@settings(max_examples=25, deadline=None)
def test_a_window_counts_what_its_rows_count(seed: int) -> None:
    rng = random.Random(seed)
    session, most = Session(), rng.choice([10, 100, 1000])
    for _ in range(rng.randrange(1, 6)):
        go_on(rng, session, most)
        if rng.random() < 0.3:
            session.restart()
    ask(rng, session, 6)


@given(seed=st.integers(0, 2**32))
@settings(max_examples=12, deadline=None)
def test_of_both_orders_the_one_that_decides_is_told(seed: int) -> None:
    rng = random.Random(seed)
    session = Session(rng.choice(["publication", "arrival"]))
    for _ in range(3):
        go_on(rng, session, 300, both=True)
    ask(rng, session, 6)


@given(seed=st.integers(0, 2**32))
@settings(max_examples=12, deadline=None)
def test_what_is_revised_is_told_as_it_stands(seed: int) -> None:
    rng = random.Random(seed)
    session = Session()
    for _ in range(3):
        go_on(rng, session, 400)
        positions = [each.position for each in session.steps if each.revision is None]
        standing = {
            position: Standing(
                (rng.choice(OUTCOMES), rng.choice([*OUTCOMES, None])),
                (rng.random() < 0.1, False),
                {0: explanation(session.steps[0].step, "p")} if rng.random() < 0.2 else {},
            )
            for position in rng.sample(positions, min(len(positions), rng.randrange(1, 200)))
        }
        session.revise(standing)
        ask(rng, session, 3)
    before = session.kept_blocks
    session.database.execute("DELETE FROM blocks")
    session.restart()
    while session.kept_blocks != before:
        count = len(session.kept_blocks)
        session.catch_up()
        assert len(session.kept_blocks) > count, "what is made anew is not what was made at first"


@given(seed=st.integers(0, 2**32))
@settings(max_examples=12, deadline=None)
def test_what_was_deleted_is_not_told(seed: int) -> None:
    rng = random.Random(seed)
    session = Session()
    for _ in range(4):
        go_on(rng, session, 400)
        if session.steps:
            session.forget(rng.choice(session.steps[-rng.choice([8, 400]) :]).position)
        found = session.ask(Question())
        assert sum(found["steps"]) == len(session.steps)
        blocks = [(level, block) for _, level, block, *_ in session.kept_blocks]
        first = session.steps[0].position if session.steps else session.last + 1
        assert all(block * SIZE * 8**level + 1 >= first for level, block in blocks)


@pytest.mark.parametrize("kept", [2, 32, 33, 256, 257, 1025])
def test_blocks_tell_what_rows_tell_once_the_beginning_was_deleted(kept: int) -> None:
    """At the edges of blocks and beside them, with what is written, revised and deleted after that."""
    rng = random.Random(kept)
    session = Session()
    session.add(some(rng, 1, 1500, 10**6))
    for go in range(3):
        session.forget(kept + 32 * go)
        if rng.random() < 0.5:
            session.restart()
        session.add(some(rng, session.last + 1, rng.choice([1, 31, 300]), session.steps[-1].step.time))
        first = next(each.position for each in session.steps if each.revision is None)
        session.revise({first: Standing((Outcome.FALSE, Outcome.UNKNOWN), (True, False), {})})
        alone = Session(database=sqlite3.connect(":memory:", isolation_level=None), steps=session.steps)
        session.database.backup(alone.database)
        alone.database.execute("DELETE FROM blocks")
        for question in (Question(signals=SIGNALS), Question(buckets=2000), *(window(rng, session) for _ in range(3))):
            found, by_rows = session.ask(question), alone.ask(question)
            check(found, session.steps, session.decides)
            check(by_rows, session.steps, session.decides)
            same = ("since", "width", "buckets", "position")
            assert [found[key] for key in same] == [by_rows[key] for key in same]
            assert "F" in found["lanes"]["p"] or question.since is not None


@pytest.mark.parametrize("seed", range(5))
def test_what_an_older_version_wrote_is_caught_up_with_while_more_is_written(seed: int) -> None:
    rng = random.Random(seed)
    session = Session()
    session.add(some(rng, 1, 5000, 10**6))
    wanted = session.kept_blocks
    session.database.execute("DELETE FROM blocks")
    session.restart()
    session.add(some(rng, 5001, 40, 10**8))
    assert session.kept_blocks == [], "a session that is behind is left to those who catch up"
    check(session.ask(Question(signals=SIGNALS)), session.steps, "publication")
    for turn in range(5):
        if turn:  # some of its blocks are there, and more are not
            session.revise({7: Standing((Outcome.FALSE, Outcome.FALSE), (False, True))})
            wanted = [row for row in session.kept_blocks if row[1:3] == (0, 0)] + wanted[1:]
            assert wanted[0][5] == "FF"
        session.catch_up(*some(rng, session.last + 1, 30, 10**8 + turn * 10**7))
    assert {row[1:3] for row in wanted} <= {row[1:3] for row in session.kept_blocks}
    session.add(some(rng, session.last + 1, 300, 10**9))
    ask(rng, session, 10)
    assert (0, session.last // SIZE - 1) in [(level, block) for _, level, block, *_ in session.kept_blocks]


@given(seed=st.integers(0, 2**32))
@settings(max_examples=15, deadline=None)
def test_what_has_changed_since_a_position_is_told_in_whole_buckets(seed: int) -> None:
    rng = random.Random(seed)
    session = Session()
    go_on(rng, session, 300)
    for _ in range(6):
        after, changed = session.last, list[int]()
        if rng.random() < 0.5:
            go_on(rng, session, rng.choice([3, 100]))
        if session.steps and rng.random() < 0.4:
            changed = [each.position for each in rng.sample(session.steps, 1) if each.revision is None]
            change = [Change(0, "p", 2 * p - 1, 2 * p - 1, Outcome.FALSE, degraded=False) for p in changed]
            stands = Standing((Outcome.FALSE, Outcome.TRUE), (False, False))
            session.revise(dict.fromkeys(changed, stands), *change)
        width = 10 ** rng.randrange(2, 6)
        found = session.ask(Question(after=after, width=width, buckets=2000, signals=SIGNALS))
        rows = [(time, each.position) for time, each in counted(session.steps, "publication")]
        times = [time for time, position in rows if position > after or position in changed]
        if session.last == after:
            assert found == {}
        elif found.get("again"):
            assert rows[-1][0] - min(times, default=rows[-1][0]) > 1000 * width
        else:
            assert found["width"] == width
            assert found["since"] <= min(times, default=rows[-1][0] if rows else 0)
            assert found["position"] == session.last
            check(found, session.steps, "publication")


def test_of_too_much_news_all_is_to_be_asked_for_anew() -> None:
    session = Session()
    session.add(some(random.Random(1), 1, MOST_NEWS + 1, 10**6))
    assert session.ask(Question(after=0, width=10**15)) == {"position": MOST_NEWS + 1, "again": True}
    assert session.ask(Question(after=1, width=10**15))["buckets"] == 1


def test_who_has_read_further_than_there_is_asks_for_all_anew() -> None:
    """It has read another session that had the name: it was told nothing until this one had as many steps."""
    session = Session()
    session.add(some(random.Random(1), 1, 20, 10**6))
    assert session.ask(Question(after=20, width=10**9)) == {}
    assert session.ask(Question(after=21, width=10**9)) == {"position": 20, "again": True}


def test_a_session_of_no_steps_tells_nothing() -> None:
    found = Session().ask(Question())
    assert (found["position"], found["first"], found["last"]) == (0, None, None)
    assert found["lanes"] == {"p": " ", "q": " "}
    assert found["steps"] == [0]


def test_buckets_are_on_one_grid_whoever_asks() -> None:
    one, other = grid(1_000_003, 1_900_000, 100), grid(1_200_001, 2_050_000, 100)
    assert (one.width, one.since, one.buckets) == (10_000, 1_000_000, 91)
    assert (other.width, other.since) == (10_000, 1_200_000)
    assert grid(5, 5, 1) == (5, 1, 1)
    assert grid(0, 10**18, 2000).width == 10**15


def test_long_texts_of_many_rows_are_not_read_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Thirty rows of 900 kB in one call held the interpreter, and so all decisions, for 30 ms."""
    read: list[int] = []
    at_once = blocks._all_signals

    def noted(text: str) -> list[dict[str, Any]]:
        read.append(len(text))
        return at_once(text)

    monkeypatch.setattr(blocks, "_all_signals", noted)
    long, short = [json.dumps({"v": i, "text": "x" * 9_000}) for i in range(20)], ['{"v": 1}'] * 20
    assert blocks._sketches(long) == {"v": [20, 0, 19, 190], "text": [0, 0, 0, 0, None]}
    assert blocks._sketches(short) == {"v": [20, 1, 1, 20]}
    assert len(read) == 1


@pytest.mark.parametrize("values", [[1.7e308], [-1.7e308, -1.7e308], [0.1, 0.1, 0.1]])
def test_a_mean_lies_between_the_least_and_the_largest(values: list[float]) -> None:
    """The sum of numbers near the largest one is cut off, and its mean was told as 1e300."""
    found = columns._signal([blocks._of_numbers(values)])
    assert found["mean"] == [values[0]]
