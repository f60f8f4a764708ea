"""The paper's Algorithm 1 does what the paper says of it: it orders, it starves, and it deadlocks."""

from __future__ import annotations

from benchmarks.paper.algorithm1 import Arrival, never_released, replay


def test_messages_are_released_in_order_once_every_topic_has_one() -> None:
    late = Arrival("/percentage", 10, 30)
    status, more = Arrival("/status", 20, 25), Arrival("/status", 40, 45)
    assert replay([status, late, more]) == {late: 30, status: 45, more: 45}


def test_a_silent_topic_starves_all_others_until_the_run_is_interrupted() -> None:
    many = [Arrival("/percentage", n, n) for n in range(1, 100)]
    rare = Arrival("/status", 98, 98)
    released = replay([*many, rare])
    assert {released[m] for m in many[:97]} == {98}


def test_the_first_of_two_messages_of_one_stamp_is_lost() -> None:
    first, second = Arrival("/percentage", 10, 10), Arrival("/status", 10, 11)
    assert list(replay([first, second])) == [second]


def test_a_call_inside_the_callback_deadlocks() -> None:
    """The request waits for the caller's next status, and the caller for the answer."""
    request = Arrival("/SetLED", 30, 31, "request")
    trace = [Arrival("/percentage", n, n + 1) for n in range(0, 400, 10)]
    trace += [Arrival("/status", 25, 26), request, Arrival("/SetLED", 32, 33, "response"), Arrival("/status", 125, 126)]

    def inside(later: Arrival, cause: Arrival) -> bool:
        return later.arrived > cause.arrived and later.buffer != "/percentage"

    def apart(later: Arrival, cause: Arrival) -> bool:
        return later.arrived > cause.arrived and later.kind == "response"

    assert never_released(trace, inside) == [request]
    assert never_released(trace, apart) == []
