"""When a deadline is said to be settled is when it is: neither is it looked at in vain, nor too late."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.events import Order, StreamKey
from oracle_server.core.ordering.reorder import ReorderBuffer
from oracle_server.core.ordering.returning import SILENT
from oracle_server.core.ordering.settling import Settling
from oracle_server.core.spec import Ordering

A, B = (StreamKey(name, "topic") for name in ("/a", "/b"))
UNIT = SILENT // 5
SOME = st.integers(0, 12)


def settling_of(since: int, held: int | None, told: int | None, **ordering: Any) -> Settling:
    """Of a session that waits for /b, and whose monitor is back `since` then; times in units."""
    buffer: ReorderBuffer[str] = ReorderBuffer(None, 100)
    buffer.open("m", (A, B))
    if held is not None:
        assert buffer.push("held", ("m", A), "", held * UNIT, 0) == []
    settling = Settling(Ordering(**ordering), buffer)
    settling.returning.expect("m")
    if told is None:
        settling.returning.left("m", since * UNIT)
    else:
        settling.returning.came("m", since * UNIT)
        settling.returning.hear("m", told * UNIT, since * UNIT)
    return settling


@settings(max_examples=500, deadline=None)
@given(
    order=st.sampled_from(("arrival", "publication")),
    late=st.sampled_from(("judge", "revise")),
    wait=st.integers(1, 4),
    since=SOME,
    held=st.none() | SOME,
    told=st.none() | SOME,
    deadline=st.builds(lambda n, less: n * UNIT - less, st.integers(1, 12), st.integers(0, 1)),
)
def test_a_deadline_is_settled_from_when_it_is_due_on(
    order: Order, late: Any, wait: int, since: int, held: int | None, told: int | None, deadline: int
) -> None:
    settling = settling_of(since, held, told, max_delay=wait * UNIT, late=late)
    due = settling.due(order, deadline, since * UNIT, None)
    expected = deadline + 1
    if order == "publication":
        behind = held is not None and deadline >= held * UNIT and late != "revise"
        waits = wait * UNIT * (2 if behind else 1)
        expected = max(deadline, since * UNIT) + waits
        if told is not None and told * UNIT < deadline + waits:
            expected = max(expected, since * UNIT + SILENT)
    assert due == expected
    before = settling.until(order, expected - 1, None)
    assert before is None or before < deadline
    for now in range(expected, expected + 9 * UNIT, UNIT):
        until = settling.until(order, now, None)
        assert until is not None
        assert until >= deadline


@pytest.mark.parametrize("held", [None, 3])
def test_without_a_bound_no_time_settles_a_deadline_in_the_order_of_publication(held: int | None) -> None:
    settling = settling_of(0, held, None, max_delay=None)
    assert settling.due("publication", 5 * UNIT, 9 * UNIT, None) is None
    assert settling.until("publication", 10**6 * UNIT, None) is None
    assert settling.due("arrival", 5, 9, None) == 6
    assert settling.until("arrival", 9, None) == 8


def test_no_time_settles_a_deadline_while_a_monitor_is_awaited() -> None:
    settling = settling_of(0, None, None, max_delay=UNIT)
    settling.returning.expect("n")
    assert settling.due("publication", 5 * UNIT, 9 * UNIT, None) is None
    assert settling.until("publication", 100 * UNIT, None) is None
    settling.returning.came("n", 100 * UNIT)
    assert settling.due("publication", 5 * UNIT, 100 * UNIT, None) == 100 * UNIT + SILENT
