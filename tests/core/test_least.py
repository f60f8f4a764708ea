"""The least of values that mostly rise: as brute force has it, and without a look at each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.events import StreamKey
from oracle_server.core.ordering import frontiers
from oracle_server.core.ordering.credit import Credit
from oracle_server.core.ordering.frontiers import Frontier
from oracle_server.core.ordering.least import Least
from oracle_server.core.ordering.reorder import ReorderBuffer

A, B = (StreamKey(name, "topic") for name in ("/a", "/b"))


@dataclass(eq=False)
class Item:
    """An item with a value, None where it does not count any more."""

    number: int
    value: int | None


@settings(max_examples=500, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 30), st.none() | st.integers(0, 9)), max_size=150), st.integers(0, 9))
def test_it_is_as_brute_force_has_it(acts: list[tuple[int, int | None]], bound: int) -> None:
    items: dict[int, Item] = {}
    least: Least[Item] = Least(lambda item: item.value)
    for number, value in acts:
        item = items.setdefault(number, Item(number, value))
        before, item.value = item.value, value
        if before is None or (value is not None and value <= before):
            least.add(item)
        there = [item for item in items.values() if item.value is not None]
        there.sort(key=lambda item: (item.value, item.number))
        assert least.first() == next(((item.value, item) for item in there), None)
        below = [item for item in there if item.value is not None and item.value < bound]
        assert least.below(bound) == below
        assert least.below(bound, 3) == below[:3]


@settings(max_examples=300, deadline=None)
@given(
    st.lists(
        st.tuples(st.sampled_from("ooppppccx"), st.integers(0, 3), st.booleans(), st.sampled_from("uvw"),
                  st.integers(0, 12)),
        max_size=60,
    )
)  # fmt: skip
def test_whom_and_what_the_order_waits_for_is_as_brute_force_has_it(
    acts: list[tuple[str, int, bool, str, int]],
) -> None:
    """Those at the limit, ahead of it, and the names of what is behind a time."""
    buffer: ReorderBuffer[int] = ReorderBuffer(None, 1_000)
    for act, number, first, publisher, stamp in acts:
        monitor, stream = f"m{number}", A if first else B
        if act == "p":
            buffer.push(0, (monitor, stream), publisher, stamp, 0)
        elif act == "c":
            buffer.clock(((monitor, stream), stamp))
        else:
            buffer.open(monitor, {"o": (A, B), "x": ()}[act])
        at = buffer.frontiers
        known = [reached for reached in at.values() if reached is not None]
        limit = min(known) if len(known) == len(at) and at else None
        assert buffer.limit == limit
        assert buffer.behind == {monitor for (monitor, _), reached in at.items() if reached == limit}
        for name in {name for name, _ in at}:
            assert buffer.is_ahead(name) == (name not in buffer.behind)
        names = {key.name for (_, key), reached in at.items() if reached is None or reached < stamp}
        assert buffer.unheard(stamp) == names


@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(st.sampled_from("ppppcx"), st.integers(0, 3), st.integers(0, 12)), max_size=80))
def test_who_gets_credit_is_who_wants_it_and_is_not_ahead(acts: list[tuple[str, int, int]]) -> None:
    """Whether or not it was looked at before."""
    buffer: ReorderBuffer[int] = ReorderBuffer(None, 16)
    credit, wanting = Credit(16), set[str]()
    for number in range(4):
        buffer.open(f"m{number}", (A,))
        credit.open(f"m{number}")
    for act, number, stamp in acts:
        monitor = f"m{number}"
        if act == "p":
            credit.spend(monitor)
            wanting |= {monitor} if credit.left[monitor] <= 0 else set()
            buffer.push(0, (monitor, A), "", stamp, 0)
        elif act == "c":
            buffer.clock(((monitor, A), stamp))
        else:
            buffer.open(monitor, (A,))
            credit.open(monitor)
            wanting.discard(monitor)
        able = {m for m in wanting if len(buffer) <= 8 or not buffer.is_ahead(m)}
        assert [m for m, _ in credit.grant(buffer)] == sorted(able)
        wanting -= able


@pytest.mark.parametrize("clocks", [False, True])
@pytest.mark.parametrize("capacity", [100, 100_000])
def test_an_event_costs_no_look_at_each_monitor(monkeypatch: pytest.MonkeyPatch, clocks: bool, capacity: int) -> None:
    looks, monitors, rounds = 0, 1_000, 3

    def counted(read: Any) -> Any:
        def look(frontier: Frontier) -> Any:
            nonlocal looks
            looks += 1
            return read(frontier)

        return look

    monkeypatch.setattr(frontiers, "_reached", counted(frontiers._reached))
    monkeypatch.setattr(frontiers, "_shown", counted(frontiers._shown))
    buffer: ReorderBuffer[int] = ReorderBuffer(10, capacity)
    credit, events, released = Credit(capacity), 0, 0
    for turn in range(rounds):
        for monitor in range(monitors):
            events += 1
            name, stamp = f"m{monitor}", events
            if turn == 0:
                buffer.open(name, (A,))
                credit.open(name)
            credit.spend(name)
            done = buffer.advance(events) + buffer.push(events, (name, A), "", stamp, events)
            done += buffer.clock(((name, A), stamp + 1)) if clocks else []
            released += len(done)
            buffer.unheard(stamp)
            credit.grant(buffer)
    assert released > events / 2
    assert looks < 50 * events, "each once or a few times, and not a thousand times"
