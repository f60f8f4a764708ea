"""Deadlocks and starvation that `check` foresees, from what a spec declares and what a ROS graph makes possible."""

from __future__ import annotations

import pytest

from oracle_server.core.hazards.deadlocks import deadlocks, starvation
from oracle_server.core.hazards.dependencies import GraphNode, dependencies, paths
from oracle_server.core.spec import Ordering, Spec, StreamSpec


def service(name: str, **more: bool) -> tuple[StreamSpec, StreamSpec]:
    both = {"action": "filter", "proxy": f"{name}_mon", **more}
    return StreamSpec(name, "request", **both), StreamSpec(name, "response", **both)  # type: ignore[arg-type]


UAV = (
    StreamSpec("/battery_percentage"),
    StreamSpec("/battery_status"),
    StreamSpec("/status_accepted"),
    *service("/SetLED"),
)
BATTERY = GraphNode("/battery", publishes=frozenset({"/battery_percentage"}))
SUPERVISOR = GraphNode(
    "/supervisor",
    publishes=frozenset({"/battery_status", "/status_change"}),
    subscribes=frozenset({"/battery_percentage", "/status_change"}),
    calls=frozenset({"/SetLED_mon"}),
)
PANEL = GraphNode("/panel", publishes=frozenset({"/status_accepted"}), serves=frozenset({"/SetLED"}))
MONITOR = GraphNode(
    "/uav1",
    subscribes=frozenset({"/battery_percentage", "/battery_status"}),
    serves=frozenset({"/SetLED_mon"}),
    calls=frozenset({"/SetLED"}),
)
ROBOT = (BATTERY, SUPERVISOR, PANEL)


def spec(*streams: StreamSpec, max_delay: int | None = None) -> Spec:
    return Spec("s", streams or UAV, (), Ordering(max_delay=max_delay))


def cycles(found: Spec, *graph: GraphNode) -> list[str]:
    return [p.message.split(": ")[1] for p in deadlocks(found, graph)]


def test_the_paper_s_robot_deadlocks_by_its_graph_alone() -> None:
    """A request waits for a status, which a supervisor that waits for the answer does not publish."""
    found = list(deadlocks(spec(), ROBOT))
    assert sorted(p.message.split(": ")[1] for p in found) == [
        "/SetLED -> /battery_status -> /SetLED",
        "/SetLED -> /status_accepted -> /SetLED",
    ]
    assert all(p.path == ("streams", 3, "causes") for p in found)
    assert "a message on /SetLED waits in the order for /battery_status" in " ".join(p.message for p in found)
    assert "(the graph has it by /supervisor)" in " ".join(p.message for p in found)
    assert "give `max_delay` an end" in found[0].message


def test_an_end_to_the_wait_is_the_mend() -> None:
    assert cycles(spec(max_delay=1), *ROBOT) == []


def test_so_is_taking_one_of_them_out_of_the_order() -> None:
    unordered = (StreamSpec("/battery_status", ordered=False), StreamSpec("/status_accepted", ordered=False))
    assert cycles(spec(*unordered, *service("/SetLED")), *ROBOT) == []
    assert cycles(spec(*UAV[:3], *service("/SetLED", ordered=False)), *ROBOT) == []


def test_a_path_goes_through_what_the_spec_does_not_observe() -> None:
    filtered = StreamSpec("/battery_percentage", action="filter")
    relay = GraphNode("/relay", subscribes=frozenset({"/battery_percentage_mon"}), publishes=frozenset({"/raw"}))
    node = GraphNode("/node", subscribes=frozenset({"/raw"}), publishes=frozenset({"/battery_status"}))
    assert cycles(spec(filtered, UAV[1]), relay, node) == [
        "/battery_percentage -> /raw -> /battery_status -> /battery_percentage"
    ]


def test_a_monitor_in_the_graph_is_no_cause() -> None:
    assert sorted(cycles(spec(), *ROBOT, MONITOR)) == sorted(cycles(spec(), *ROBOT))
    forwards = GraphNode(
        "/uav1",
        subscribes=frozenset({"/battery_percentage_mon", "/battery_status"}),
        publishes=frozenset({"/battery_percentage"}),
    )
    assert dependencies(spec(StreamSpec("/battery_percentage", action="filter"), UAV[1]), [forwards]) == {}


def test_a_node_that_only_listens_or_only_speaks_makes_nothing_wait() -> None:
    logger = GraphNode("/logger", subscribes=frozenset({"/SetLED", "/battery_status"}))
    assert cycles(spec(), BATTERY, logger) == []


def test_a_shortest_path_is_told() -> None:
    edges = {"/a": {"/b": "", "/c": ""}, "/b": {"/c": ""}, "/c": {"/a": "", "/d": ""}}
    assert list(paths("/a", edges)) == [("/a", "/b"), ("/a", "/c"), ("/a", "/c", "/d")]


@pytest.mark.parametrize("max_delay", [None, 1])
def test_a_stream_on_which_nobody_speaks_starves_the_others(max_delay: int | None) -> None:
    found = list(starvation(spec(max_delay=max_delay), (BATTERY, SUPERVISOR)))
    if max_delay is None:
        (problem,) = found
        assert problem.severity == "warning"
        assert "no node of the graph publishes /status_accepted" in problem.message
    else:
        assert found == []
