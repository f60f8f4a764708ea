"""One timer for many deadlines: none is missed, none comes early."""

from __future__ import annotations

from typing import Dict, List, Set, Tuple

from hypothesis import given
from hypothesis import strategies as st
from oracle_adapter.deadlines import Deadlines

steps = st.lists(
    st.one_of(
        st.tuples(st.just("ask"), st.integers(0, 20)),
        st.tuples(st.just("answer"), st.integers(0, 30)),
        st.tuples(st.just("wait"), st.integers(0, 15)),
    ),
    max_size=60,
)


@given(steps)
def test_each_ask_that_waits_runs_out_when_its_time_is_over(steps: List[Tuple[str, int]]) -> None:
    deadlines, now = Deadlines(), 0
    waiting: Dict[int, int] = {}
    count = 0
    for what, value in steps:
        if what == "ask":
            count += 1
            waiting[count] = now + value
            earlier = deadlines.add(now + value, count)
            assert deadlines.timer is not None
            assert deadlines.timer <= now + value
            assert not earlier or deadlines.timer == now + value
        elif what == "answer":
            waiting.pop(value, None)
        else:
            end, over = now + value, set(waiting.values())
            ran_out: Set[int] = set()
            while deadlines.timer is not None and deadlines.timer <= end:
                now = max(now, int(deadlines.timer))
                due = deadlines.take_due(now, waiting)
                assert all(waiting[number] == now for number in due), "it came late"
                ran_out.update(due)
                for number in due:
                    del waiting[number]
            now = end
            assert all(at > now for at in waiting.values()), "one was missed"
            assert bool(ran_out) == any(at <= end for at in over)


def test_the_timer_is_not_set_anew_for_each_ask() -> None:
    deadlines = Deadlines()
    assert [deadlines.add(10.0 + number, number) for number in range(5)] == [True] + [False] * 4
    assert deadlines.add(1.0, 9)
    assert deadlines.take_due(1.0, {4}) == []
    assert deadlines.timer == 14.0
