"""What the port promises holds for every backend."""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncGenerator
from pathlib import Path
from typing import Literal

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oracle_server
from oracle_server.core.bypass import Bypass
from oracle_server.core.events import By, StreamKey
from oracle_server.core.verdicts import FINAL, Decision, Outcome
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.port import History
from oracle_server.history.query import Query
from oracle_server.history.records import (
    Extent,
    MonitorRecord,
    Refusal,
    SnapshotRecord,
    StoredStep,
)
from oracle_server.history.sqlite.history import SqliteHistory
from oracle_server.history.views import records
from oracle_server.history.whose import Whose
from tests.history.making import PROPERTIES, add, asked_for, find, opened, some_steps, step

Direction = Literal["asc", "desc"]
FALSE, TRUE, HELD = Outcome.CURRENTLY_FALSE, Outcome.TRUE, Outcome.CURRENTLY_TRUE


async def collected(pages: AsyncGenerator[list[StoredStep], None]) -> list[StoredStep]:
    return [stored async for page in pages for stored in page]


async def test_an_empty_history_knows_nothing(history: History) -> None:
    assert await history.last_number() == await history.last_time() == 0
    assert await history.open_sessions() == []
    assert await history.session("s") is None
    assert await history.closed_state("s") is None
    assert await history.closed_states(10) == []
    assert await history.extents() == []
    assert await history.extent(1) == (1, 0)
    assert await collected(history.steps(1, 0)) == []
    assert not await history.monitors(1)
    assert not await history.refusals(1)
    assert await history.snapshot(1) is None
    assert history.failure is None


async def test_done_is_called_once_what_was_given_is_found(history: History) -> None:
    history.open_session(opened())
    done = asyncio.Event()
    history.append(1, [step(1), step(2)], done.set)
    assert not done.is_set()
    await done.wait()
    assert await history.extent(1) == (1, 2)
    assert history.pending == 0


async def test_commands_are_done_in_the_order_in_which_they_were_given(history: History) -> None:
    told: list[int] = []
    history.open_session(opened())
    history.append(1, [step(1)], lambda: told.append(1))
    history.amend(1, "m", 1, (True, "decision"), lambda: told.append(2))
    history.refuse(1, Refusal("m", 2, 0, 5, "bad_event", "data: no"), lambda: told.append(3))
    history.append(1, [step(2, seq=3)], lambda: told.append(4))
    await history.flush()
    assert told == [1, 2, 3, 4]
    first = await history.step(1, 1)
    assert first is not None
    assert (first.passed, first.why) == (True, "decision")


async def test_what_was_done_with_an_event_stands_where_it_was_decided(history: History) -> None:
    """And not at its step in the other order, whether it is written already or not."""
    other, decided = (step(position, seq=1, decision=Decision("allow", ())) for position in (1, 2))
    history.open_session(opened())
    history.append(1, [msgspec.structs.replace(other, order="arrival", decision=None), decided], lambda: None)
    history.amend(1, "m", 1, (True, "timeout"), lambda: None)
    await history.flush()
    found = [await history.step(1, position) for position in (1, 2)]
    assert [(one.passed, one.why) for one in found if one is not None] == [(None, None), (True, "timeout")]


async def test_a_session_is_open_until_it_is_closed(history: History) -> None:
    first, second = opened(1, "one"), opened(2, "two", private=True)
    history.open_session(first)
    history.open_session(second)
    await history.flush()
    assert await history.open_sessions() == [first, second]
    assert await history.session("two") == await history.session(2) == second
    history.close_session(1, 77, {"id": "one", "closed": 77})
    await history.flush()
    assert await history.open_sessions() == [second]
    assert await history.session("one") == first
    assert await history.closed_state("one") == {"id": "one", "closed": 77}
    assert await history.closed_state("two") is None
    assert await history.last_number() == 2


async def test_closed_sessions_are_listed_the_newest_first(history: History) -> None:
    for number in (1, 2, 3):
        history.open_session(opened(number, f"s{number}"))
        history.close_session(number, number, {"id": f"s{number}"})
    await history.flush()
    assert await history.closed_states(2) == [{"id": "s3"}, {"id": "s2"}]
    assert await history.closed_states(1, Whose(sessions=frozenset({"s1", "s2"}))) == [{"id": "s2"}]
    assert await history.closed_states(1, Whose(specs=frozenset({"another"}))) == []


async def test_a_monitor_takes_the_place_of_the_one_of_its_name(history: History) -> None:
    history.open_session(opened())
    streams = (StreamKey("/a", "topic"), StreamKey("/s", "request"))
    for instance, attached in (("i", True), ("j", False)):
        history.set_monitor(1, MonitorRecord("m", instance, streams, attached, "sim", left=None if attached else 2**62))
    await history.flush()
    assert await history.monitors(1) == [MonitorRecord("m", "j", streams, attached=False, clock="sim", left=2**62)]


async def test_sessions_are_found_by_how_their_names_begin(history: History) -> None:
    names = ["s", "s.run2", "s.run10", "s.runs", "s_run2", "s.Run2", "t.run2", "s.run"]
    for number, name in enumerate(names, start=1):
        history.open_session(opened(number, name)._replace(kind="recording" if number == 2 else "robot"))
    history.close_session(2, 1, {})
    await history.flush()
    assert sorted(await history.names("s.run")) == ["s.run", "s.run10", "s.run2", "s.runs"]
    found = await history.session("s.run2")
    assert found is not None
    assert found.kind == "recording"


async def test_the_bypassed_streams_of_a_monitor_and_the_begin_of_its_session_are_kept(history: History) -> None:
    history.open_session(opened())
    key, done = StreamKey("/s", "request"), asyncio.Event()
    record = MonitorRecord("m", "i", (key,), True, "wall", {key: Bypass("by /rogue", 2**62)})
    history.begin_session(1, 2**62 + 1)
    history.set_monitor(1, record, done.set)
    await done.wait()
    assert await history.monitors(1) == [record]
    found = await history.session(1)
    assert found is not None
    assert found.begun == 2**62 + 1


async def test_a_snapshot_takes_the_place_of_the_last_one_and_is_read_when_it_is_given(history: History) -> None:
    history.open_session(opened())
    data = {"judges": {"publication": [1, 2]}}
    history.save_snapshot(1, SnapshotRecord(3, {}, 1))
    history.save_snapshot(1, SnapshotRecord(5, data, 2, {"m": [1, 0, []]}))
    data.clear()
    await history.flush()
    assert await history.snapshot(1) == SnapshotRecord(5, {"judges": {"publication": [1, 2]}}, 2, {"m": [1, 0, []]})


async def test_the_step_of_a_decided_event_is_found_by_its_number(history: History) -> None:
    history.open_session(opened())
    decided = step(2, seq=8, decision=Decision("deny", ("q",)))
    await add(history, step(1, seq=7), decided)
    assert await history.asked_step(1, "m", 8) == decided
    assert await history.asked_step(1, "m", 7) is None
    assert await history.asked_step(1, "n", 8) is None
    assert await history.asked_step(2, "m", 8) is None


async def test_steps_come_whole_over_many_pages(history: History) -> None:
    history.open_session(opened())
    made = [step(position, arrived=10_000 - position) for position in range(1, 2502)]
    await add(history, *made)
    assert await collected(history.steps(1, 0)) == made
    assert await collected(history.steps(1, 1000, 2001)) == made[1000:2001]
    assert await collected(history.by_arrival(1)) == made[::-1]


async def extents(history: History) -> list[Extent]:
    """What is kept of each session's steps: a session here takes something beside them, as its one refused event."""
    found = await history.extents()
    assert all(extent.beside > 0 and extent.refused == 1 for extent in found)
    return [extent._replace(beside=0, refused=0) for extent in found]


async def test_what_is_forgotten_is_gone_and_nothing_else(history: History) -> None:
    for number in (1, 2):
        history.open_session(opened(number, f"s{number}"))
        history.set_monitor(number, MonitorRecord("m", "i", (), attached=True, clock="wall"))
        history.refuse(number, Refusal("m", 9, 0, 5, "bad_event", "no"), lambda: None)
        history.save_snapshot(number, SnapshotRecord(2, {}))
        await add(history, *(step(i) for i in range(1, 6)), session=number)
    await history.forget_steps(1, 4)
    assert await extents(history) == [Extent(1, "spec", None, 0, 4, 5), Extent(2, "spec", None, 0, 1, 5)]
    await history.forget_session(1)
    assert await extents(history) == [Extent(2, "spec", None, 0, 1, 5)]
    assert await history.session(1) is None
    assert await history.snapshot(1) is None
    assert not await history.monitors(1)
    assert not await history.refusals(1)
    assert len(await history.monitors(2)) == len(await history.refusals(2)) == 1


async def test_refusals_are_found_behind_a_number_of_each_monitor(history: History) -> None:
    history.open_session(opened())
    for monitor in ("m", "k"):
        for seq in (1, 2, 3):
            history.refuse(1, Refusal(monitor, seq, 0, 5, "bad_event", "no"), lambda: None)
    await history.flush()
    assert await history.refused(1) == len(await history.refusals(1)) == 6
    assert await history.refused(2) == 0
    found = await history.refusals(1, {"m": 1, "k": 3, "unknown": 0})
    assert sorted((refusal.monitor, refusal.seq) for refusal in found) == [("m", 2), ("m", 3)]
    assert await history.refusals(1, {}) == []


async def test_times_are_found_by_bisection(history: History) -> None:
    history.open_session(opened())
    await add(history, *(step(i) for i in range(1, 8)))
    (extent,) = await history.extents()
    assert [await history.judged_before(extent, time) for time in (0, 100, 101, 701)] == [0, 0, 1, 7]
    assert await history.last_time() == 700
    assert await history.size() > 0


async def test_the_deciding_step_is_found(history: History) -> None:
    history.open_session(opened())
    deny = Decision("deny", ("p",))
    await add(
        history,
        step(1),
        step(2, kind="request", stream="/s", decision=Decision("allow", ())),
        step(3, kind="request", stream="/s", decision=deny),
        step(4, number=None),
        step(5, kind="tick", number=None, outcomes=(HELD, TRUE)),
        step(6, outcomes=(HELD, TRUE)),
    )
    assert await history.first_final(1, "publication", 1, 6) == 5
    assert await history.first_final(1, "publication", 1, 4) is None
    assert await history.first_final(1, "publication", 0, 6) is None
    assert await history.first_final(1, "arrival", 1, 6) is None
    assert await history.last_counted(1, "publication", 5, [StreamKey("/s", "request")]) == 2
    assert await history.last_counted(1, "publication", 5, []) == 3
    assert await history.last_counted(1, "arrival", 5, []) is None


ROBUST = msgspec.structs.replace(step(1), robustness=(float("inf"), -0.5), passed=False, why="timeout")


def marked(**fields: object) -> StoredStep:
    """A step whose event has a call, a source and losses, with more fields of the step."""
    made = step(1, decision=Decision("deny", ("p",)))
    event = msgspec.structs.replace(made.step.event, source="/node", call=7, lost=3)
    whole = msgspec.structs.replace(made.step, event=event, **fields)
    return msgspec.structs.replace(made, step=whole, gap=2)


@pytest.mark.parametrize(
    "kept",
    [
        ROBUST,
        msgspec.structs.replace(step(1), robustness=(None, float("-inf"))),
        marked(late=True),
        marked(skewed=True),
        marked(forced=True),
        marked(failed=frozenset({"speed", "mode"})),
        step(1, number=None),
        msgspec.structs.replace(marked(), number=None),  # an attempt that was taken back
        msgspec.structs.replace(step(1), degraded=(True, True), bypassed=(1,)),
        msgspec.structs.replace(step(1), degraded=(False, True), bypassed=(1,)),
        msgspec.structs.replace(step(1), pending={1: 7}),
    ],
)
async def test_a_step_is_kept_whole(history: History, kept: StoredStep) -> None:
    history.open_session(opened())
    await add(history, kept)
    assert await history.step(1, 1) == kept


@pytest.mark.parametrize("by", [None, "arrival"])
async def test_a_session_is_kept_whole(history: History, by: By | None) -> None:
    record = opened(private=by is not None)._replace(by=by)
    history.open_session(record)
    await history.flush()
    assert await history.session(1) == await history.session("s") == record
    assert await history.open_sessions() == [record]


@pytest.mark.parametrize("order", ["asc", "desc"])
async def test_what_is_asked_for_is_found_however_much_else_may_match(history: History, order: Direction) -> None:
    """A property is not looked at by a backend, so that most of what it finds is not wanted."""
    history.open_session(opened())
    own = [1, 2, 51, 52, 53, 103, 104, 160]
    await add(history, *(step(i, outcomes=(FALSE, FALSE if i in own else HELD)) for i in range(1, 161)))
    query = Query(frozenset({"q"}), frozenset({FALSE}), limit=50, order=order)
    found, after = await find(history, opened(), query)
    assert [record["n"] for record in found] == sorted((2 * i for i in own), reverse=order == "desc")
    assert after is None
    found, after = await find(history, opened(), Query(limit=3, order=order))
    assert [record["n"] for record in found] == ([1, 2, 3] if order == "asc" else [320, 319, 318])
    assert after == found[-1]["n"]


async def test_times_that_bound_a_question_are_included(history: History) -> None:
    history.open_session(opened())
    await add(history, *(step(i) for i in range(1, 6)))
    found, _ = await find(history, opened(), Query(since=20, until=40))
    assert sorted({record["stamp"] for record in found}) == [20, 30, 40]


async def test_the_data_of_an_event_is_not_kept(history: History) -> None:
    history.open_session(opened())
    whole = step(1)
    event = msgspec.structs.replace(whole.step.event, data={"image": "…"})
    await add(history, msgspec.structs.replace(whole, step=msgspec.structs.replace(whole.step, event=event)))
    assert await history.step(1, 1) == whole


@st.composite
def queries(draw: st.DrawFn) -> Query:
    times = st.none() | st.integers(0, 60)
    return Query(
        draw(st.frozensets(st.sampled_from(PROPERTIES))),
        draw(st.frozensets(st.sampled_from(Outcome))),
        draw(st.none() | st.sampled_from(["/a", "/b"])),
        draw(times),
        draw(times),
        draw(st.none() | st.integers(0, 30)),
        draw(st.integers(1, 30)),
        draw(st.sampled_from(["asc", "desc"])),
        draw(st.booleans()),
    )


@given(steps=some_steps(), query=queries())
@settings(max_examples=60)
def test_backends_answer_a_query_as_it_says(
    steps: list[StoredStep], query: Query, tmp_path_factory: pytest.TempPathFactory
) -> None:
    async def ask(history: History) -> None:
        history.start(asyncio.get_running_loop())
        session = opened()
        history.open_session(session)
        await add(history, *steps)
        found, after = await find(history, session, query)
        wanted = asked_for([r for stored in steps for r in records(stored, PROPERTIES)], query)
        assert found == wanted[: query.limit]
        assert after == (found[-1]["n"] if len(wanted) > query.limit else None)
        assert (await history.extent(session.number))[1] == len(steps)
        ordered = sorted(
            steps, key=lambda s: (s.step.event.arrived, s.step.event.monitor, s.step.event.seq, s.position)
        )
        assert await collected(history.by_arrival(1)) == ordered
        for index in (0, 1):
            final = next((s.position for s in steps if s.outcomes[index] in FINAL), None)
            assert await history.first_final(1, "publication", index, len(steps)) == final
        await asyncio.to_thread(history.close)

    folder: Path = tmp_path_factory.mktemp("history")
    for history in (MemoryHistory(), SqliteHistory(folder)):
        asyncio.run(ask(history))


def test_no_statement_stands_outside_a_backend() -> None:
    """A further backend needs no other files than its own, and to copy or forward it those that know two databases."""
    package = Path(oracle_server.__file__).parent
    statement = re.compile(r"\b(SELECT .* FROM|INSERT INTO|UPDATE \w+ SET|DELETE FROM|CREATE TABLE|PRAGMA)\b")
    backends = {package / "history" / name for name in ("sql", "sqlite", "postgres", "copying", "forwarding")}
    bags = package / "replay" / "files" / "sqlitefile.py"  # a recording of rosbag2 is such a database
    assert [
        path
        for path in package.rglob("*.py")
        if path.parent not in backends and path != bags and statement.search(path.read_text(encoding="utf-8"))
    ] == []
    assert statement.search((package / "history" / "sql" / "history.py").read_text(encoding="utf-8"))
