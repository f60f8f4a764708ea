"""What a service's proxy passes on, on real ROS 1."""

from __future__ import annotations

import signal
from io import BytesIO
from itertools import chain, repeat
from pathlib import Path
from typing import Any, Self

import pytest
from std_srvs.srv import SetBool, SetBoolRequest, SetBoolResponse

from tests.processes import eventually
from tests.robot import SWITCH, changed, done, spec_folder
from tests.ros1.harness import Scene

LATIN = b"\x01\x04\0\0\0caf\xe9"
"""A response whose text is no UTF-8."""


class AnswerInLatin(SetBoolResponse):  # type: ignore[misc]
    """What its server sends."""

    def serialize(self, buffer: BytesIO) -> None:
        buffer.write(LATIN)


class AsItCame(SetBoolResponse):  # type: ignore[misc]
    """Has what came as its text."""

    def deserialize(self, data: bytes) -> Self:
        self.message = data.hex()
        return self


class TwiceTrue(SetBoolRequest):  # type: ignore[misc]
    """A request whose Boolean is 2, as that of a client in C may be, with something behind its end."""

    def serialize(self, buffer: BytesIO) -> None:
        buffer.write(b"\x02\x07")


class RequestAsItCame(SetBoolRequest):  # type: ignore[misc]
    def deserialize(self, data: bytes) -> Self:
        self.data = data.hex()
        return self


class Serving(SetBool):  # type: ignore[misc]
    _request_class = RequestAsItCame


class Calling(SetBool):  # type: ignore[misc]
    _request_class, _response_class = TwiceTrue, AsItCame


class Torn(SetBoolRequest):  # type: ignore[misc]
    """A request that ends before its Boolean."""

    def serialize(self, buffer: BytesIO) -> None:
        pass


class TornAnswer(SetBoolResponse):  # type: ignore[misc]
    """A response that ends within its text."""

    def serialize(self, buffer: BytesIO) -> None:
        buffer.write(b"\x01\x04\0")


class CallingTorn(SetBool):  # type: ignore[misc]
    _request_class = Torn


class Older(SetBool):  # type: ignore[misc]
    """The same by another definition."""

    _md5sum = "0" * 32


ANSWERS = chain([TornAnswer()], repeat(SetBoolResponse(success=True)))


def torn_at_first(_: Any) -> SetBoolResponse:
    return next(ANSWERS)


def answer_in_latin(_: Any) -> AnswerInLatin:
    return AnswerInLatin()


def test_a_call_passes_byte_for_byte(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        adapter, panel, caller = scene.adapter("switch"), scene.peer(), scene.peer()
        panel.serve(Serving, "/switch", answer_in_latin)
        answer, error = caller.call(Calling, "/switch_mon", TwiceTrue())
        assert error is None
        assert bytes.fromhex(answer.message) == LATIN
        assert [request.data for request in panel.reached("/switch")] == ["0207"]
        told = [(event["kind"], event["passed"]) for event in scene.server.events("s")]
        assert told == [("request", True), ("response", True)]
        adapter.ends_well()


def test_what_cannot_be_read_is_an_error_at_the_client_and_lost(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        adapter, panel, caller = scene.adapter("switch"), scene.peer(), scene.peer()
        panel.serve(SetBool, "/switch", torn_at_first)
        _, error = caller.call(CallingTorn, "/switch_mon", Torn())
        assert "the request of /switch can't be read: " in str(error)
        adapter.said("/switch: a request can't be read, and its caller gets an error: ")
        assert panel.reached("/switch") == []
        _, error = caller.call(SetBool, "/switch_mon", SetBoolRequest(data=True))
        assert "the response of /switch can't be read: " in str(error)
        adapter.said("a response can't be read, and its caller gets an error: ")
        _, error = caller.call(SetBool, "/switch_mon", SetBoolRequest(data=True))
        assert error is None
        counters = eventually(lambda: scene.server.session("s")["counters"], lambda found: found["lost"] == 2)
        assert counters["steps"] == 3
        adapter.ends_well()
        assert "Traceback" not in adapter.log


def test_who_calls_by_another_definition_is_told(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        adapter, panel, caller = scene.adapter("switch"), scene.peer(), scene.peer()
        panel.serve(SetBool, "/switch", answer_in_latin)
        _, error = caller.call(Older, "/switch_mon", SetBoolRequest(data=True))
        assert "md5sums do not match" in str(error)
        adapter.said(
            "/switch: /peer1 calls /switch_mon by another type than std_srvs/SetBool, or another definition of it "
            "than is installed here: it gets an error"
        )
        assert panel.reached("/switch") == []
        adapter.said("/switch: recovered")
        adapter.ends_well()


def test_a_server_of_another_definition_is_told(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        adapter, panel, caller = scene.adapter("switch"), scene.peer(), scene.peer()
        panel.serve(Older, "/switch", answer_in_latin)
        _, error = caller.call(SetBool, "/switch_mon", SetBoolRequest(data=True))
        assert "md5sums do not match" in str(error)
        adapter.said("/switch: a call of /switch does not come through: unable to connect to service: ")
        eventually(lambda: done(scene.server.events("s")), lambda found: found == [("request", "allow", False)])
        adapter.ends_well()


def say_on(_: Any) -> SetBoolResponse:
    return SetBoolResponse(True, "on")


@pytest.mark.parametrize("away", ["dead", "hanging"])
def test_who_keeps_a_connection_goes_on_to_be_served_without_a_master(away: str, tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        adapter, panel, caller = scene.adapter("switch"), scene.peer(), scene.peer()
        panel.serve(SetBool, "/switch", say_on)
        caller.until(lambda: caller.call(SetBool, "/switch_mon", True)[0], lambda: "nobody serves /switch")
        caller.connect_service(SetBool, "/switch_mon")
        assert caller.call(SetBool, "/switch_mon", True)[1] is None
        if away == "dead":
            scene.master.remove()
        else:
            scene.master.send(signal.SIGSTOP)
        assert [caller.call(SetBool, "/switch_mon", data)[1] is None for data in (True, False, True)] == [
            True, False, True,
        ]  # fmt: skip
        scene.master.send(signal.SIGCONT)
        adapter.ends_well()


def test_who_keeps_a_connection_goes_on_to_be_served_by_a_session_made_anew(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        adapter, panel, caller = scene.adapter("switch"), scene.peer(), scene.peer()
        panel.serve(SetBool, "/switch", say_on)
        caller.until(lambda: caller.call(SetBool, "/switch_mon", True)[0], lambda: "nobody serves /switch")
        caller.connect_service(SetBool, "/switch_mon")
        assert caller.call(SetBool, "/switch_mon", True)[1] is None
        scene.server.kill()
        changed(tmp_path)
        scene.server.restart()
        adapter.said("observing 3 streams")
        assert caller.call(SetBool, "/switch_mon", True) == (SetBoolResponse(True, "on"), None)
        assert "denied the request of /switch: only_on" in str(caller.call(SetBool, "/switch_mon", False)[1])
        adapter.ends_well()


def test_a_service_that_a_new_master_does_not_know_goes_on_to_be_called(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        adapter, panel, caller = scene.adapter("switch"), scene.peer(), scene.peer()
        panel.serve(SetBool, "/switch", say_on)
        assert caller.call(SetBool, "/switch_mon", True)[1] is None
        scene.restart_master()
        adapter.said("registered again")
        assert caller.call(SetBool, "/switch_mon", True)[1] is None
        assert len(panel.reached("/switch")) == 2
        panel.close()
        assert "service [/switch] unavailable" in str(caller.call(SetBool, "/switch_mon", True)[1])
        adapter.ends_well()


def test_a_time_that_its_type_does_not_have_is_told(tmp_path: Path) -> None:
    spec = SWITCH.replace("std_srvs/SetBool", "battery_uav_msgs/SetLED").replace("on: msg.data", "on: msg.id > 0")
    spec = spec.replace("request: {signals", "request: {stamp: at, signals").replace("msg.message", "string(msg.id)")
    with Scene(tmp_path, spec_folder(tmp_path, spec)) as scene:
        adapter = scene.adapter("switch")
        adapter.said(
            "/switch: the request of battery_uav_msgs/srv/SetLED has no time at `at`: ordered by arrival instead"
        )
        adapter.ends_well()
