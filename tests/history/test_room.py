"""What goes of a history that has too much beside the events of good sessions."""

from __future__ import annotations

import secrets
from collections.abc import Iterable

import pytest

from oracle_server.core.spec import Retention
from oracle_server.history.port import History
from oracle_server.history.records import Refusal, SnapshotRecord
from oracle_server.history.retention import Pruner
from tests.history.making import add, opened, step

KEPT = 1_000


async def flown(history: History, number: int, events: int) -> None:
    """A closed session with events."""
    history.open_session(opened(number, f"flight{number}"))
    await add(history, *(step(i) for i in range(1, events + 1)), session=number)
    history.close_session(number, number, {})
    await history.flush()


async def left_empty(history: History, numbers: Iterable[int], text: str = "id: spec") -> None:
    """Closed sessions without events, each of a spec of its own."""
    for number in numbers:
        history.open_session(opened(number, f"empty{number}")._replace(text=text and text + secrets.token_hex(10_000)))
        history.close_session(number, number, {})
    await history.flush()


async def refused(history: History, session: int, seqs: Iterable[int], monitor: str = "m") -> None:
    """Events that can't be judged, each a little later than the one before."""
    for seq in seqs:
        refusal = Refusal(monitor, seq, 0, 5 + seq, "bad_event", "a number is too large")
        history.refuse(session, refusal, lambda: None)
    await history.flush()


def pruner(history: History, bounds: Retention, saved: list[int] | None = None) -> Pruner:
    """What prunes; it notes which sessions are to be saved."""
    return Pruner(history, bounds, dict, lambda age: 10**18 - age, ([] if saved is None else saved).append)


async def numbers(history: History) -> list[int]:
    """Which sessions are kept."""
    return [extent.number for extent in await history.extents()]


async def test_sessions_without_events_make_room_before_those_that_have_some(history: History) -> None:
    await flown(history, 1, 500)
    await left_empty(history, range(2, 42))
    await flown(history, 42, 500)
    bounds = Retention(size=await history.size() - 200_000)
    for _ in range(3):
        await pruner(history, bounds).prune()
    left = await numbers(history)
    assert left[0] == 1
    assert left[-1] == 42
    assert left[1:-1] == [*range(42 - len(left) + 2, 42)], "the oldest go first"
    assert 20 < len(left) < 42
    assert [await history.extent(number) for number in (1, 42)] == [(1, 500), (1, 500)]


async def test_what_is_beside_events_makes_them_no_dearer(history: History) -> None:
    """Open sessions keep what they have; the closed one gives what is too much, and no more."""
    await flown(history, 1, 3000)
    alone = await history.size()
    for number in range(2, 42):
        history.open_session(opened(number, f"s{number}")._replace(text=secrets.token_hex(10_000)))
    await history.flush()
    bounds = Retention(size=await history.size() - alone // 3)
    for _ in range(5):
        await pruner(history, bounds).prune()
    first, last = await history.extent(1)
    assert last == 3000
    assert 600 < first < 1800, "about a third goes"


@pytest.mark.parametrize("bounds", [Retention(events=10), Retention(size=1)], ids=["events", "size"])
async def test_a_session_without_events_goes_in_its_turn(history: History, bounds: Retention) -> None:
    await left_empty(history, (1, 2), "")
    await flown(history, 3, 10)
    await flown(history, 4, 10)
    await history.forget_steps(3, 11)  # as where a server is killed before it has forgotten the rest
    await flown(history, 5, 10)
    await left_empty(history, (6,), "")
    await pruner(history, bounds).prune()
    assert await numbers(history) == ([5, 6] if bounds.events else [])


async def test_sessions_without_events_stay_where_nothing_is_too_much(history: History) -> None:
    await left_empty(history, (1, 2))
    await flown(history, 3, 10)
    await pruner(history, Retention(events=10, size=10**9)).prune()
    assert await numbers(history) == [1, 2, 3]


async def test_an_open_session_keeps_the_last_of_many_refused_events(history: History) -> None:
    await flown(history, 1, 200)
    history.open_session(opened(2, "other"))
    await refused(history, 2, range(1, 5001))
    saved: list[int] = []
    bounds = Retention(size=await history.size() - 100)
    await pruner(history, Retention(size=10**9), saved).prune()
    assert saved == [2], "what a start would need stays until it is saved"
    assert await history.refused(2) == 5000
    history.save_snapshot(2, SnapshotRecord(0, {}, 0, {"m": [4999, 0, []]}))
    await history.flush()
    for _ in range(3):
        await pruner(history, bounds, saved).prune()
    assert sorted(refusal.seq for refusal in await history.refusals(2)) == [*range(5001 - KEPT, 5001)]
    assert saved == [2]
    assert await history.extent(1) == (1, 200)


async def test_refused_events_stay_that_a_start_needs(history: History) -> None:
    history.open_session(opened(1))
    await refused(history, 1, range(1, 2001))
    await refused(history, 1, range(2001, 2101), monitor="k")
    history.save_snapshot(1, SnapshotRecord(0, {}, 0, {"m": [500, 0, [[700, 700, 1]]]}))
    await history.flush()
    await pruner(history, Retention(events=1)).prune()
    found = {(refusal.monitor, refusal.seq) for refusal in await history.refusals(1)}
    assert found == {("m", seq) for seq in range(501, 2001)} | {("k", seq) for seq in range(2001, 2101)}


async def test_nothing_goes_without_a_bound(history: History) -> None:
    history.open_session(opened(1))
    await refused(history, 1, range(1, 2101))
    history.save_snapshot(1, SnapshotRecord(0, {}, 0, {"m": [2100, 0, []]}))
    await history.flush()
    await pruner(history, Retention()).prune()
    assert await history.refused(1) == 2100
