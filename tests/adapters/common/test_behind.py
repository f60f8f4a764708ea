"""What waits for what came before it."""

from __future__ import annotations

import threading
from functools import partial
from typing import List

from oracle_adapter.behind import LONGEST, Behind
from tests.adapters.common.links import PATIENCE


def test_nothing_before_it_is_no_wait() -> None:
    behind, called = Behind(), []
    first = behind.came("other")
    behind.after("goal", lambda: called.append("at once"))
    assert called == ["at once"]
    behind.settle("other", first)
    behind.settle("other", first)
    behind.after("other", lambda: called.append("again"))
    assert called == ["at once", "again"]


def test_it_waits_for_all_of_its_goal_that_came_before_and_for_nothing_else() -> None:
    behind, called = Behind(), []
    first, second, other = behind.came("goal"), behind.came("goal"), behind.came("other")
    behind.after("goal", lambda: called.append("result"))
    later = behind.came("goal")
    behind.settle("goal", second)
    behind.settle("other", other)
    assert called == []
    behind.settle("goal", first)
    assert called == ["result"], "though more came later"
    behind.after("goal", lambda: called.append("result again"))
    behind.settle("goal", later)
    assert called == ["result", "result again"]


def test_it_waits_for_a_time_at_most() -> None:
    now = [0.0]
    behind, called = Behind(lambda: now[0]), []
    number = behind.came("goal")
    behind.after("goal", lambda: called.append("result"))
    now[0] = LONGEST - 0.01
    behind.catch_up()
    assert called == []
    now[0] = LONGEST
    behind.catch_up()
    behind.settle("goal", number)
    behind.catch_up()
    assert called == ["result"]


def test_at_the_end_nothing_waits() -> None:
    behind = Behind()
    called: List[str] = []
    for goal in ("one", "two"):
        behind.came(goal)
        behind.after(goal, partial(called.append, goal))
    behind.release()
    assert called == ["one", "two"]


def test_threads_that_settle_at_once_call_it_once() -> None:
    for _ in range(200):
        behind = Behind()
        called: List[str] = []
        numbers = [behind.came("goal") for _ in range(4)]
        behind.after("goal", partial(called.append, "result"))
        begin = threading.Barrier(len(numbers))

        def settle(number: int, behind: Behind = behind, begin: threading.Barrier = begin) -> None:
            begin.wait(PATIENCE)
            behind.settle("goal", number)

        threads = [threading.Thread(target=settle, args=[number]) for number in numbers]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(PATIENCE)
        assert called == ["result"]
