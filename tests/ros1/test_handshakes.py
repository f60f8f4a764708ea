"""Those who connect to the adapter for ROS 1, and say late or never what they want."""

from __future__ import annotations

import re
import socket
import struct
import sys
from pathlib import Path
from urllib.parse import urlsplit
from xmlrpc.client import ServerProxy

import pytest
from oracle_ros1 import handshakes
from std_srvs.srv import SetBool, SetBoolResponse

from tests.robot import SWITCH, spec_folder
from tests.ros1.harness import Scene


def put(_: object) -> SetBoolResponse:
    return SetBoolResponse(success=True)


def address_of(scene: Scene, service: str) -> tuple[str, int]:
    """Where a service is."""
    with ServerProxy(scene.settings["ROS_MASTER_URI"]) as master:
        code, _, uri = master.lookupService("/test", service)  # type: ignore[misc]
    found = urlsplit(str(uri))
    assert code == 1
    assert found.hostname
    assert found.port
    return found.hostname, found.port


def test_one_who_says_nothing_keeps_no_call_waiting(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        adapter, panel, caller = scene.adapter("switch"), scene.peer(), scene.peer()
        panel.serve(SetBool, "/switch", put)
        with socket.create_connection(address_of(scene, "/switch_mon")) as silent:
            silent.sendall(b"\x10\0")  # half of what a header begins with
            answer, error = caller.call(SetBool, "/switch_mon", True)
            assert error is None
            assert answer.success
        adapter.ends_well()


def test_one_who_calls_by_another_definition_and_says_no_name_is_told(tmp_path: Path) -> None:
    said = [b"service=/switch_mon", b"md5sum=" + 32 * b"0", b"type=std_srvs/SetBool"]
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        adapter, panel = scene.adapter("switch"), scene.peer()
        panel.serve(SetBool, "/switch", put)
        header = b"".join(struct.pack("<I", len(field)) + field for field in said)
        with socket.create_connection(address_of(scene, "/switch_mon")) as nameless:
            nameless.sendall(struct.pack("<I", len(header)) + header)
            adapter.said("/switch: an unknown node calls /switch_mon by another type than std_srvs/SetBool, or ")
        adapter.ends_well()


def test_one_who_says_nothing_is_hung_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(handshakes, "SAID_WITHIN", 0.05)
    ours, theirs = socket.socketpair()
    with ours, theirs:
        handshakes._hear(lambda _server, connection, _address: assert_over(connection), None, ours, None)
        assert_over(theirs)


def assert_over(connection: socket.socket) -> None:
    assert connection.recv(1) == b""


@pytest.mark.parametrize(
    ("name", "address", "why"),
    [
        ("ROS_HOSTNAME", "robot.invalid", "which is not known here"),
        ("ROS_IP", "192.0.2.1", "where it does not reach itself"),  # an address that no machine has
    ],
)
def test_an_adapter_tells_that_nobody_can_connect_to_it(name: str, address: str, why: str, tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        words = ("--oracle", scene.server.url, "--spec", "switch")
        command = ("env", "--unset=ROS_IP", f"{name}={address}", sys.executable, "-m", "oracle_ros1", *words)
        adapter = scene.run("adapter", *command)
        adapter.said(rf"other nodes are told to connect to this one at http://{re.escape(address)}:\d+/, {why}")
        assert "are told to connect" not in scene.adapter("switch").log
