"""Back-pressure: who may send more, and that heeding it keeps the order within its capacity."""

from __future__ import annotations

from itertools import product

from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.events import StreamKey
from oracle_server.core.ordering.credit import Credit
from oracle_server.core.ordering.reorder import Released, ReorderBuffer

A, B = (StreamKey(name, "topic") for name in ("/a", "/b"))
SOURCES = list(product(("m", "n", "o"), (A, B)))

often = settings(max_examples=200, deadline=None)


def test_a_monitor_ahead_gets_no_more_until_it_is_waited_for() -> None:
    buffer: ReorderBuffer[int] = ReorderBuffer(None, 16)
    credit = Credit(16)
    for monitor in ("fast", "slow"):
        buffer.open(monitor, (A,))
        assert credit.open(monitor) == 1
    assert credit.share == 2
    granted = []
    for stamp in range(1, 13):
        credit.spend("fast")
        buffer.push(stamp, ("fast", A), "", stamp, 0)
        granted += [(stamp, *grant) for grant in credit.grant(buffer)]
    assert granted == [(stamp, "fast", 2) for stamp in (1, 3, 5, 7)]
    assert credit.left["fast"] == 9 - 12
    buffer.clock((("slow", A), 11))
    assert buffer.awaited == ("slow", A)
    assert credit.grant(buffer) == [("fast", 5)], "the order has got on"


@often
@given(
    capacity=st.integers(1, 40),
    happenings=st.lists(
        st.tuples(
            st.sampled_from(("push", "push", "push", "clock", "open", "close")),
            st.sampled_from(SOURCES),
            st.integers(0, 12),
        ),
        max_size=60,
    ),
)
def test_whom_the_order_waits_for_always_gets_credit(
    capacity: int, happenings: list[tuple[str, tuple[str, StreamKey], int]]
) -> None:
    buffer: ReorderBuffer[int] = ReorderBuffer(None, capacity)
    credit = Credit(capacity)
    told: dict[str, int] = {}
    for what, (monitor, stream), number in happenings:
        match what:
            case "push" if monitor in told:
                told[monitor] -= 1
                credit.spend(monitor)
                buffer.push(0, (monitor, stream), "", number, 0)
            case "clock":
                buffer.clock(((monitor, stream), number))
            case "open":
                buffer.open(monitor, (stream,))
                told[monitor] = credit.open(monitor)
            case "close":
                buffer.close(monitor)
                credit.close(monitor)
                told.pop(monitor, None)
        for name, events in credit.grant(buffer):
            assert events > 0
            told[name] += events
        assert told == credit.left
        for name, left in told.items():
            held_up = left <= 0
            assert not held_up or buffer.is_ahead(name)
            assert not held_up or len(buffer) > capacity // 2
        assert buffer.awaited is None or told[buffer.awaited[0]] > 0


@often
@given(monitors=st.integers(2, 6), data=st.data(), counts=st.lists(st.integers(0, 60), min_size=6, max_size=6))
def test_monitors_that_heed_it_never_overfill_the_order_nor_wait_for_each_other(
    monitors: int, data: st.DataObject, counts: list[int]
) -> None:
    """Each monitor has one stream, says at its end that nothing follows, and is picked in any sequence."""
    capacity = 4 * monitors + data.draw(st.integers(0, 20))
    buffer: ReorderBuffer[tuple[int, int]] = ReorderBuffer(None, capacity)
    credit = Credit(capacity)
    names = [f"m{i}" for i in range(monitors)]
    left = {name: list(range(i, monitors * counts[i], monitors)) for i, name in enumerate(names)}
    for name in names:
        buffer.open(name, (A,))
        credit.open(name)
    released: list[Released[tuple[int, int]]] = []
    while any(left.values()):
        for name in names:
            if not left[name]:
                released += buffer.clock(((name, A), 10**6))
        credit.grant(buffer)
        able = [name for name in names if left[name] and credit.left[name] > 0]
        assert able, "all wait for each other"
        name = data.draw(st.sampled_from(able))
        stamp = left[name].pop(0)
        credit.spend(name)
        released += buffer.push((stamp, names.index(name)), (name, A), "", stamp, 0)
        credit.grant(buffer)
    released += buffer.flush()
    assert not any(r.forced or r.late for r in released)
    assert [r.item for r in released] == sorted(r.item for r in released)
