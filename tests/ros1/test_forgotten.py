"""Whom the adapter asks itself, as a restarted master does not know what they publish."""

from __future__ import annotations

import socket
import threading
from typing import Any
from xmlrpc.client import Fault
from xmlrpc.server import SimpleXMLRPCServer

import pytest
from oracle_ros1 import forgotten
from oracle_ros1.forgotten import ASK_PERIOD, GONE_AFTER, Forgotten

BOTH = {"/a", "/b"}


def answering(answer: Any, port: int = 0) -> SimpleXMLRPCServer:
    """A node that says so of what it publishes, until it is shut down and closed."""

    def publications(_caller: str) -> Any:
        if isinstance(answer, Fault):
            raise answer
        return answer

    node = SimpleXMLRPCServer(("127.0.0.1", port), logRequests=False)
    node.register_function(publications, "getPublications")
    threading.Thread(target=node.serve_forever, daemon=True).start()
    return node


def address(server: Any) -> str:
    return f"http://127.0.0.1:{server.getsockname()[1]}/"


@pytest.mark.parametrize(
    ("answer", "left"),
    [
        ((1, "", [["/a", "std_msgs/Int64"], ["/c", "std_msgs/Int64"]]), {"/a"}),
        ((1, "", []), set()),
        ((0, "not now", 0), BOTH),
        ((1, "", 5), BOTH),
        ((1, "", [5]), BOTH),
        ("what", BOTH),
        (Fault(1, "method not found"), BOTH),
    ],
)
def test_a_node_publishes_on_unless_it_says_otherwise(answer: Any, left: set[str]) -> None:
    """What is no answer must not end the look either: nobody else would be told of any more."""
    asked = Forgotten()
    with answering(answer) as node:
        asked.add("/pilot", address(node.socket), BOTH)
        assert asked.look() == ({"/pilot": left} if left else {})
        node.shutdown()
    assert asked.look() == {}
    assert "/pilot" not in asked


def test_a_node_that_can_not_be_reached_is_gone_after_a_minute_until_it_answers_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its machine may have been switched off, or be out of the network's reach."""
    monkeypatch.setattr(forgotten, "NODE_WITHIN", 0.05)
    now = [1000.0]
    asked = Forgotten(lambda: now[0])
    with socket.create_server(("127.0.0.1", 0)) as silent:  # takes connections, and reads nothing
        port = silent.getsockname()[1]
        asked.add("/pilot", address(silent), BOTH)
        assert asked.look() == {"/pilot": BOTH}
        now[0] += GONE_AFTER
        assert asked.look() == {"/pilot": BOTH}
        now[0] += 1
        assert asked.look() == {}
        assert "/pilot" in asked
    with answering((1, "", [["/b", "std_msgs/Int64"]]), port) as node:
        assert asked.look() == {}, "it is not asked all the time, as that takes a second"
        now[0] += ASK_PERIOD
        assert asked.look() == {"/pilot": {"/b"}}
        node.shutdown()
