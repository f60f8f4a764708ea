"""What the adapter asks the master."""

from __future__ import annotations

import socket
import threading
from typing import Any
from xmlrpc.client import Fault
from xmlrpc.server import SimpleXMLRPCServer

import pytest
import rospy
from oracle_ros1 import graph


def test_a_master_that_does_not_answer_is_not_waited_for_without_end(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:  # takes connections, and reads nothing
        monkeypatch.setenv("ROS_MASTER_URI", f"http://127.0.0.1:{silent.getsockname()[1]}")
        monkeypatch.setattr(graph, "REPLY_WITHIN", 0.05)
        with pytest.raises(OSError, match="timed out"):
            graph.master_proxy().getSystemState()


def test_a_node_that_can_not_be_reached_where_it_says_it_is_keeps_nothing_waiting(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As where ROS_IP is wrong: the master would not be asked meanwhile, who publishes past the monitor not seen."""
    monkeypatch.setattr(graph, "ASK_WITHIN", 0.05)
    with socket.create_server(("127.0.0.1", 0)) as silent:  # takes connections, and reads nothing
        uri = f"http://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(OSError, match="timed out"):
            graph._connect(Master(lossy=False), "/number", "std_msgs/Int64", uri)


class Topics:
    """What rospy has of this node: one subscriber."""

    def get_publications(self) -> list[tuple[str, str]]:
        return []

    def get_subscriptions(self) -> list[tuple[str, str]]:
        return [("/number", "std_msgs/Int64")]

    def get_services(self) -> list[tuple[str, str]]:
        return []


class Master:
    """A master that was restarted, whose answer to the first registration is lost where `lossy`."""

    def __init__(self, *, lossy: bool) -> None:
        self._lossy, self._subscribers = lossy, list[str]()

    def getSystemState(self) -> Any:  # noqa: N802 - as ROS calls it
        return 1, "", [[["/number", ["/speaker"]]], [["/number", self._subscribers]], []]

    def lookupNode(self, _node: str) -> Any:  # noqa: N802
        return -1, "", 0

    def registerSubscriber(self, _name: str, _kind: str, _uri: str) -> Any:  # noqa: N802
        self._subscribers.append(rospy.get_name())
        if self._lossy:
            self._lossy = False
            raise OSError("timed out")
        return 1, "", ["http://speaker:1/"]


@pytest.mark.parametrize("lossy", [False, True])
def test_a_subscriber_that_was_registered_again_and_not_connected_is_so_at_the_next_look(
    lossy: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[list[str]] = []

    def publisher_update(_caller: str, _topic: str, publishers: list[str]) -> Any:
        told.append(publishers)
        return (1, "", 0) if lossy or len(told) > 1 else None  # which can't be sent

    with SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False) as node:
        node.register_function(publisher_update, "publisherUpdate")
        threading.Thread(target=node.serve_forever, daemon=True).start()
        monkeypatch.setattr(rospy, "get_node_uri", lambda: f"http://127.0.0.1:{node.server_address[1]}/")
        for manager in ("get_topic_manager", "get_service_manager"):
            monkeypatch.setattr(graph.registration, manager, Topics)
        looking, master = graph.Graph(), Master(lossy=lossy)
        with pytest.raises((OSError, Fault)):
            looking._look(master)
        for _ in range(3):
            looking._look(master)
        node.shutdown()
    assert told == [["http://speaker:1/"]] * (1 if lossy else 2)


class Knowing(Master):
    """A master that knows who publishes what."""

    def __init__(self) -> None:
        super().__init__(lossy=False)
        self.publishers: list[list[Any]] = []
        self.asked = 0

    def getSystemState(self) -> Any:  # noqa: N802
        self.asked += 1
        return 1, "", [self.publishers, [["/number", [rospy.get_name()]]], []]


def test_who_is_a_monitor_is_asked_at_once_of_a_node_of_which_the_master_has_not_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Else what a monitor says in its first second would be the robot's."""
    for manager in ("get_topic_manager", "get_service_manager"):
        monkeypatch.setattr(graph.registration, manager, Topics)
    monkeypatch.setattr(graph, "ASK_AGAIN", 0)
    looking, master = graph.Graph(), Knowing()
    monkeypatch.setattr(graph, "master_proxy", lambda _seconds: master)
    robot, monitor = ["/rosout", ["/robot"]], [["/uav2/monitor_error", ["/uav2"]], ["/uav2/monitor_verdict", ["/uav2"]]]
    master.publishers = [robot]
    looking._look(master)
    assert not looking.is_monitor("/robot")
    assert master.asked == 1
    assert not looking.is_monitor("/uav2")
    master.publishers = [robot, *monitor]
    assert looking.is_monitor("/uav2")
    assert master.asked == 3
    looking._look(master)
    master.publishers = []  # it was restarted
    looking._look(master)
    assert looking.is_monitor("/uav2")
    master.publishers = [["/rosout", ["/uav2"]]]  # and is none any more
    looking._look(master)
    assert not looking.is_monitor("/uav2")
