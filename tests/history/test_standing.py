"""What stands since revisions is kept with the steps; what was said at first stays; every backend tells both."""

from __future__ import annotations

import asyncio
import sqlite3
import threading
from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import get_args

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.events import StreamKey
from oracle_server.core.records import VerdictRecord
from oracle_server.core.revisions import Change, Revision, Standing
from oracle_server.core.verdicts import Outcome
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.port import History
from oracle_server.history.query import Query
from oracle_server.history.records import Restated, StoredStep, restated, stored_revision
from oracle_server.history.sql import batch
from oracle_server.history.sql.standing import RESTATE
from oracle_server.history.sqlite.history import SqliteHistory
from oracle_server.history.views import Doubts, View, records
from tests.history.making import (
    OUTCOMES,
    PROPERTIES,
    add,
    asked_for,
    explanation,
    find,
    opened,
    revision,
    some_steps,
    step,
)
from tests.history.test_port import collected, queries

WIDTH = len(PROPERTIES)
EVERYTHING = Query()
HELD, FALSE, UNKNOWN = Outcome.CURRENTLY_TRUE, Outcome.CURRENTLY_FALSE, Outcome.UNKNOWN


def change(n: int, first: int, last: int, outcome: Outcome | None, **more: object) -> Change:
    """A change of the property that these numbers are of."""
    return msgspec.structs.replace(Change(n, PROPERTIES[(n - 1) % WIDTH], first, last, outcome, False), **more)


def stands(
    *outcomes: Outcome | None, degraded: tuple[bool, ...] = (False, False), at: StoredStep | None = None
) -> Standing:
    """What stands at a step, with an explanation of each property that is negative, where the step is given."""
    negative = [i for i, o in enumerate(outcomes) if o is FALSE] if at else []
    return Standing(outcomes, degraded, {i: explanation(at.step, PROPERTIES[i]) for i in negative if at is not None})


async def told(history: History, query: Query = EVERYTHING) -> list[VerdictRecord]:
    """All records that are found, page by page, each page with its own question."""
    found: list[VerdictRecord] = []
    while True:
        page, after = await find(history, opened(), query)
        found += page
        if after is None:
            return found
        query = replace(query, after=after)


async def revised(history: History) -> tuple[StoredStep, ...]:
    """Four steps, of which the third, a deadline, is retracted; the second violates `q` instead of `p`."""
    history.open_session(opened())
    steps = (
        step(1),
        step(2, outcomes=(FALSE, HELD), violated=[0]),
        step(3, kind="tick", outcomes=(FALSE, FALSE), violated=[1]),
        step(4),
    )
    late = msgspec.structs.replace(step(5, stamp=15), place=2)
    why = explanation(steps[1].step, "q")
    made = revision(
        6,
        change(11, 3, 3, HELD, retracted=True),
        change(12, 4, 4, FALSE, violation=True, explanation=why),
        standing={2: stands(HELD, FALSE, at=steps[1]), 3: stands(None, None)},
    )
    more = revision(7, change(13, 5, 5, None), change(14, 6, 6, None, retracted=True))
    history.append(1, steps, lambda: None)
    kept = [late, stored_revision(6, made), stored_revision(7, more)]
    history.append(1, kept, lambda: None, [made, more])
    await history.flush()
    return (*steps, *kept)


async def test_what_stands_is_told_without_what_is_retracted(history: History) -> None:
    await revised(history)
    found = await told(history)
    assert [(r["n"], r["outcome"], r.get("revised")) for r in found] == [
        (1, "currently_true", None), (2, "currently_true", None),
        (3, "currently_true", 11), (4, "currently_false", 12),
        (7, "currently_true", None), (8, "currently_true", None),
        (9, "currently_true", None), (10, "currently_true", None),
    ]  # fmt: skip
    assert [r["n"] for r in found if r["violation"]] == [4]
    assert [r["place"] for r in found if "place" in r] == [2, 2]
    assert all("revises" not in r for r in found)


async def test_what_was_said_at_first_stays(history: History) -> None:
    steps = await revised(history)
    found = await told(history, Query(view="first"))
    assert [(r["n"], r["outcome"]) for r in found[2:6]] == [
        (3, "currently_false"), (4, "currently_true"), (5, "currently_false"), (6, "currently_false"),
    ]  # fmt: skip
    assert found == [record for kept in steps[:5] for record in records(kept, PROPERTIES)]
    assert not any("revised" in r for r in found)


async def test_revisions_are_records_that_say_what_they_change_and_why(history: History) -> None:
    await revised(history)
    found = await told(history, Query(view="all"))
    assert [r["n"] for r in found] == list(range(1, 15))
    first, second, third, fourth = found[10:]
    assert (first["kind"], first["outcome"], first["retracted"], first["revises"]) == (
        "revision", "currently_true", True, {"from": 3, "to": 3},
    )  # fmt: skip
    assert (second["violation"], second["explanation"] is not None) == (True, True)
    assert (third["outcome"], third["retracted"], fourth["retracted"]) == (None, False, True)
    assert first["because"] == [{"monitor": "m", "seq": 1006, "stream": "/a", "kind": "topic", "stamp": 5}]
    assert first["causes"] == 1


@pytest.mark.parametrize(
    ("view", "follows", "numbers"),
    [
        ("standing", False, [4]),
        ("first", False, [3, 6]),
        ("all", False, [3, 6, 11, 12, 14]),
        ("standing", True, [4, 11, 12, 14]),
    ],
)
async def test_violations_are_those_of_the_view(
    history: History, view: View, follows: bool, numbers: list[int]
) -> None:
    await revised(history)
    found = await told(history, Query(view=view, violations=True, follows=follows))
    assert [r["n"] for r in found] == numbers


async def test_outcomes_are_looked_for_in_the_view(history: History) -> None:
    await revised(history)
    wanted = frozenset({FALSE})
    assert [r["n"] for r in await told(history, Query(outcomes=wanted))] == [4]
    assert [r["n"] for r in await told(history, Query(outcomes=wanted, view="first"))] == [3, 5, 6]
    assert [r["n"] for r in await told(history, Query(outcomes=wanted, view="all"))] == [3, 5, 6, 12]


async def test_a_page_may_end_between_the_changes_of_a_revision(history: History) -> None:
    await revised(history)
    for order in ("asc", "desc"):
        query = Query(view="all", limit=1, order=order)
        assert [r["n"] for r in await told(history, query)] == sorted(range(1, 15), reverse=order == "desc")


async def test_revisions_are_no_lines_of_a_trace(history: History) -> None:
    steps = await revised(history)
    found = await collected(history.by_arrival(1))
    assert sorted(s.position for s in found) == [1, 2, 3, 4, 5]
    assert [s.revision is not None for s in await collected(history.steps(1, 0))] == [False] * 5 + [True] * 2
    assert (await history.step(1, 7)) == steps[6]


async def test_what_a_revision_changes_may_be_deleted_already(history: History) -> None:
    history.open_session(opened())
    await add(history, *(step(i) for i in range(1, 6)))
    await history.forget_steps(1, 3)
    made = revision(6, change(11, 1, 9, FALSE), None, standing={p: stands(FALSE, HELD) for p in range(1, 6)})
    history.append(1, [stored_revision(6, made)], lambda: None, [made])
    await history.flush()
    assert await history.extent(1) == (3, 6)
    assert [r["n"] for r in await told(history, Query(outcomes=frozenset({FALSE})))] == [5, 7, 9]
    assert (await told(history, Query(view="all")))[-1]["revises"] == {"from": 1, "to": 9}


async def test_each_property_names_the_last_revision_of_its_own(history: History) -> None:
    history.open_session(opened())
    await add(history, step(1), step(2))
    for position, made in (
        (3, revision(3, change(5, 1, 3, FALSE), None, standing={1: stands(FALSE, HELD), 2: stands(FALSE, HELD)})),
        (4, revision(4, None, change(8, 4, 4, UNKNOWN), standing={2: stands(FALSE, UNKNOWN, degraded=(True, False))})),
    ):
        history.append(1, [stored_revision(position, made)], lambda: None, [made])
    await history.flush()
    found = await told(history)
    assert [(r["outcome"], r["degraded"], r.get("revised")) for r in found] == [
        ("currently_false", False, 5), ("currently_true", False, None),
        ("currently_false", True, 5), ("unknown", False, 8),
    ]  # fmt: skip


async def test_what_stands_of_many_steps_is_told_while_others_are_served(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 10,000 steps it takes 0.1 s."""
    threads: list[str] = []

    def noted(revisions: Iterable[Revision]) -> dict[int, Restated]:
        threads.append(threading.current_thread().name)
        return restated(revisions)

    monkeypatch.setattr(batch, "restated", noted)
    history = SqliteHistory(tmp_path)
    history.start(asyncio.get_running_loop())
    history.open_session(opened())
    made = revision(2, change(3, 1, 1, FALSE), None, standing={1: stands(FALSE, HELD)})
    history.append(1, [step(1), stored_revision(2, made)], lambda: None, [made])
    await history.flush()
    assert threads == ["history writer"]
    assert (await told(history))[0]["outcome"] == "currently_false"
    await asyncio.to_thread(history.close)


def test_several_passes_that_are_written_together_leave_what_the_last_one_says() -> None:
    first = revision(3, change(5, 1, 3, FALSE), None, standing={1: stands(FALSE, HELD), 2: stands(FALSE, HELD)})
    more = revision(4, None, change(8, 2, 2, UNKNOWN))
    again = revision(5, change(9, 3, 3, HELD), None, standing={2: stands(HELD, HELD)})
    assert restated([first, more, again]) == {
        1: Restated(stands(FALSE, HELD), {0: 5, 1: 8}), 2: Restated(stands(HELD, HELD), {0: 9}),
    }  # fmt: skip


async def test_why_an_event_was_released_and_what_was_not_heard_is_kept(history: History) -> None:
    history.open_session(opened())
    made = [step(i) for i in range(1, 4)]
    made[0] = _released(made[0], "clock")
    made[1] = _released(made[1], "max_delay", "/b", "/a")
    made[2] = _released(made[2], "max_delay", "/a")
    arm, base = ("arm", StreamKey("/b", "topic")), ("base", StreamKey("/dock", "request"))
    for i, waited in enumerate(((arm,), (arm, base), ())):
        made[i] = msgspec.structs.replace(made[i], step=msgspec.structs.replace(made[i].step, waited=waited))
    await add(history, *made)
    assert await collected(history.steps(1, 0)) == made
    found = await told(history)
    told_of = [[each["monitor"] for each in r.get("waited", ())] for r in found]
    assert told_of == [["arm"]] * 2 + [["arm", "base"]] * 2 + [[]] * 2
    assert found[2]["waited"][1] == {"monitor": "base", "stream": "/dock", "kind": "request"}
    assert [r.get("released") for r in found] == ["clock"] * 2 + ["max_delay"] * 4
    assert not any("unheard" in r for r in found)
    doubts = Doubts(20, {"/a": frozenset({0, 1}), "/b": frozenset({1})})
    found, _ = await find(history, opened(), Query(), doubts)
    assert [r.get("unheard") for r in found] == [None, None, ["/a"], ["/a", "/b"], ["/a"], ["/a"]]
    found, _ = await find(history, opened(), Query(), doubts._replace(since=21))
    assert [r.get("unheard") for r in found] == [None] * 4 + [["/a"]] * 2


def _released(made: StoredStep, why: str, *unheard: str) -> StoredStep:
    released = msgspec.structs.replace(made.step, released=why, unheard=frozenset(unheard))
    return msgspec.structs.replace(made, step=released)


@dataclass
class Life:
    """What a session gave to its history, and what stands since then, by brute force."""

    given: list[tuple[list[StoredStep], list[Revision]]] = field(default_factory=list)
    rows: list[StoredStep] = field(default_factory=list)
    standing: dict[int, Standing] = field(default_factory=dict)
    revised: dict[int, int] = field(default_factory=dict)
    """By the number of a verdict: that of the last revision of it."""

    def expected(self, query: Query) -> list[VerdictRecord]:
        """The records that a query asks for, by its words: over all of them, one by one."""
        return asked_for([record for row in self.rows for record in self._records(row, query)], query)

    def _records(self, row: StoredStep, query: Query) -> list[VerdictRecord]:
        made = records(row, PROPERTIES)
        if row.revision is not None:
            return made if query.view == "all" or (query.view == "standing" and query.follows) else []
        if query.view != "standing" or row.position not in self.standing:
            return made
        now = self.standing[row.position]
        for i, record in enumerate(made):
            outcome = now.outcomes[i]
            record["outcome"] = None if outcome is None else outcome.value
            record["degraded"] = now.degraded[i]
            record["violation"], record["explanation"] = i in now.explanations, now.explanations.get(i)
            if record["n"] in self.revised:
                record["revised"] = self.revised[record["n"]]
        return [record for record in made if record["outcome"] is not None]


@st.composite
def lives(draw: st.DrawFn) -> Life:
    """Steps with revisions in between, of any earlier steps, as several are written together."""
    life = Life()
    for made in draw(some_steps()):
        row = msgspec.structs.replace(made, position=len(life.rows) + 1)
        life.rows.append(row)
        life.given.append(([row], []))
        if draw(st.integers(0, 3)) == 0:
            passed = [_revision(draw, life) for _ in range(draw(st.integers(1, 2)))]
            life.given.append(([stored_revision(p, r) for p, r in passed], [r for _, r in passed]))
    return life


def _revision(draw: st.DrawFn, life: Life) -> tuple[int, Revision]:
    """A revision of one earlier step, or of none."""
    position = len(life.rows) + 1
    steps = [row for row in life.rows if row.revision is None]
    at = draw(st.sampled_from(steps))
    before = life.standing.get(at.position, Standing(at.outcomes, at.degraded, at.explanations))
    retracts = at.is_tick and draw(st.booleans())
    outcomes: tuple[Outcome | None, ...] = (None, None) if retracts else draw(OUTCOMES)
    violated = [] if retracts else sorted(draw(st.sets(st.sampled_from([0, 1]))))
    now = Standing(
        outcomes,
        draw(st.tuples(st.booleans(), st.booleans())),
        {i: explanation(at.step, PROPERTIES[i]) for i in violated},
    )
    changes: list[Change | None] = []
    for i, name in enumerate(PROPERTIES):
        n, of = (position - 1) * WIDTH + i + 1, (at.position - 1) * WIDTH + i + 1
        if (outcomes[i], i in now.explanations) == (before.outcomes[i], i in before.explanations):
            changes.append(None)
            continue
        life.revised[of] = n
        appears, ends = i in now.explanations, i in before.explanations
        changes.append(
            Change(n, name, of, of, outcomes[i], now.degraded[i], appears, ends, None, now.explanations.get(i))
        )
    made = revision(position, *changes, standing={at.position: now}, stamp=draw(st.integers(0, 60)))
    life.standing[at.position] = now
    life.rows.append(stored_revision(position, made))
    return position, made


@given(
    life=lives(), query=queries(), view=st.sampled_from(get_args(View)), follows=st.booleans(), limit=st.integers(1, 5)
)
@settings(max_examples=100)
def test_each_view_is_as_a_reading_of_all(
    life: Life, query: Query, view: View, follows: bool, limit: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    async def ask(history: History) -> None:
        history.start(asyncio.get_running_loop())
        history.open_session(opened())
        for rows, revisions in life.given:
            history.append(1, rows, lambda: None, revisions)
        await history.flush()
        asked = replace(query, view=view, follows=follows)
        wanted = life.expected(asked)
        found, after = await find(history, opened(), asked)
        assert found == wanted[: query.limit]
        assert after == (found[-1]["n"] if len(wanted) > query.limit else None)
        assert await told(history, replace(asked, limit=limit)) == wanted
        numbers = [record["n"] for record in await told(history, Query(view="all"))]
        assert numbers == sorted(set(numbers))
        await asyncio.to_thread(history.close)

    folder: Path = tmp_path_factory.mktemp("history")
    for history in (MemoryHistory(), SqliteHistory(folder)):
        asyncio.run(ask(history))


async def test_a_step_and_what_stands_since_then_are_committed_at_once(tmp_path: Path) -> None:
    """Whoever looks at any time sees both or neither, as does a server that was killed."""
    history = SqliteHistory(tmp_path)
    history.start(asyncio.get_running_loop())
    history.open_session(opened())
    await add(history, step(1))
    with closing(sqlite3.connect(history.path)) as database:  # what is to stand can't be written
        database.execute("CREATE TRIGGER no BEFORE UPDATE ON steps BEGIN SELECT raise(ABORT, 'no'); END")
    made = revision(3, change(5, 1, 1, FALSE), None, standing={1: stands(FALSE, HELD)})
    history.append(1, [step(2), stored_revision(3, made)], lambda: None, [made])
    await history.flush()
    assert await history.extent(1) == (1, 1)
    assert [r["outcome"] for r in await told(history)] == ["currently_true"] * 2
    await asyncio.to_thread(history.close)


def test_what_stands_is_written_by_a_look_at_each_step_that_is_revised(tmp_path: Path) -> None:
    """Else a pass of 10,000 steps takes minutes, for which nothing is committed."""
    history = SqliteHistory(tmp_path)
    with closing(sqlite3.connect(history.path)) as database:
        plan = [row[-1] for row in database.execute(f"EXPLAIN QUERY PLAN {RESTATE}", ("[]",))]
    assert plan == [
        "SCAN json_each VIRTUAL TABLE INDEX 1:", "SEARCH steps USING PRIMARY KEY (session=? AND position=?)",
    ]  # fmt: skip
    history.close()
