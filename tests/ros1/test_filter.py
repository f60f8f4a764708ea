"""Filtered topics and proxied services on real ROS 1: what passes, what doesn't, and what if the oracle is away."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import Int64, String
from std_srvs.srv import SetBool, SetBoolResponse

from tests.processes import Server, eventually, without_gaps
from tests.robot import (
    ALLOWED,
    AWAY,
    FAST,
    GATE,
    GATE_AND_LOG,
    SIDES,
    SWITCH,
    all_but_sevens,
    changed,
    done,
    settled,
    spec_folder,
)
from tests.ros1.harness import Peer, Scene


def gate(folder: Path, intercept: str = "publisher", unavailable: str = "deny", within: str = "60s") -> Scene:
    return Scene(folder, spec_folder(folder, GATE, intercept=intercept, unavailable=unavailable, within=within))


def numbers(*values: int) -> list[Int64]:
    return [Int64(data=value) for value in values]


def values(heard: Sequence[Any]) -> list[int]:
    return [said.data for said in heard]


def opened(scene: Scene, intercept: str = "publisher") -> tuple[Peer, Peer, str, str]:
    """A node that publishes and one that hears, which are connected through the adapter, and their topics."""
    speaker, hearer = scene.peer(), scene.peer()
    source, target = SIDES[intercept]
    hearer.record(Int64, target, speakers=1)
    speaker.advertise(Int64, source)
    return speaker, hearer, source, target


@pytest.mark.parametrize("intercept", ["publisher", "subscriber"])
def test_a_fast_stream_passes_in_order_but_for_what_is_denied(intercept: str, tmp_path: Path) -> None:
    with gate(tmp_path, intercept) as scene:
        adapter = scene.adapter("gate")
        speaker, hearer, source, target = opened(scene, intercept)
        every = range(1, FAST + 1)
        speaker.publish(source, *numbers(*every), rate=1000)
        allowed = [number for number in every if number % 7]
        assert values(hearer.heard(target, len(allowed))) == allowed
        all_but_sevens(scene.server, FAST)
        adapter.ends_well()


@pytest.mark.parametrize("away", AWAY)
def test_without_an_oracle_messages_pass_where_the_spec_says_so(away: Callable[[Server], None], tmp_path: Path) -> None:
    with gate(tmp_path, unavailable="pass", within="400ms") as scene:
        scene.adapter("gate")
        speaker, hearer, source, target = opened(scene)
        away(scene.server)
        began = time.monotonic()
        speaker.publish(source, *numbers(7, 8))
        assert values(hearer.heard(target, 2)) == [7, 8]
        assert time.monotonic() - began >= 0.4


@pytest.mark.parametrize("unavailable", ["deny", "pass"])
def test_a_frozen_oracle_is_done_without_as_the_spec_says_and_catches_up(unavailable: str, tmp_path: Path) -> None:
    words = {"intercept": "publisher", "unavailable": unavailable, "within": "1500ms"}
    with Scene(tmp_path, spec_folder(tmp_path, GATE_AND_LOG, **words)) as scene:
        adapter = scene.adapter("gate")
        speaker, hearer, source, target = opened(scene)
        speaker.advertise(Int64, "/logged")
        scene.server.process.send(signal.SIGSTOP)
        thawed = time.monotonic() + 5
        for topic in (source, "/logged"):
            speaker.publish(topic, *numbers(*range(1, 51)), rate=25)
        adapter.said("disconnected")
        time.sleep(max(0, thawed - time.monotonic()))
        scene.server.process.send(signal.SIGCONT)
        eventually(lambda: adapter.log.count("oracle: attached"), lambda count: count == 2)
        speaker.publish(source, *numbers(100))
        passed = [*range(1, 51)] if unavailable == "pass" else []
        assert values(hearer.heard(target, len(passed) + 1)) == [*passed, 100]
        events = eventually(lambda: scene.server.events("s"), lambda found: len(found) == 101)
        assert without_gaps([event["seq"] for event in events])
        eventually(lambda: scene.server.events("s", stream="/number")[-1]["passed"], lambda last: last is not None)
        asked = scene.server.events("s", stream="/number")
        assert [event["passed"] for event in asked] == [unavailable == "pass"] * 50 + [True]
        assert [event["decision"] for event in asked] == [("allow", "deny")[n % 7 == 0] for n in (*range(1, 51), 100)]
        adapter.ends_well()


def test_latched_messages_pass_to_who_comes_later(tmp_path: Path) -> None:
    with gate(tmp_path) as scene:
        scene.adapter("gate")
        speaker, late = scene.peer(), scene.peer()
        speaker.advertise(Int64, "/number_mon", latch=True)
        speaker.publish("/number_mon", *numbers(5))
        settled(scene.server, 1)
        late.record(Int64, "/number")
        assert values(late.heard("/number", 1)) == [5]


def test_late_subscribers_get_what_passed_of_latching_publishers_that_are_there(tmp_path: Path) -> None:
    with gate(tmp_path) as scene:
        adapter = scene.adapter("gate")
        one, other, gone, plain = (scene.peer() for _ in range(4))
        for latching in (one, other, gone):
            latching.advertise(Int64, "/number_mon", latch=True)
        plain.advertise(Int64, "/number_mon")
        seen = scene.peer()
        seen.record(Int64, "/number", speakers=1)
        for count, (speaker, number) in enumerate([(one, 5), (other, 6), (gone, 8), (plain, 9)], 1):
            speaker.publish("/number_mon", *numbers(number))
            seen.heard("/number", count)
        one.publish("/number_mon", *numbers(7))  # which is denied
        settled(scene.server, 5)
        gone.withdraw("/number_mon")

        def late() -> list[int]:
            """What a new node hears, until it hears what is published last."""
            hearer = scene.peer()
            hearer.record(Int64, "/number", speakers=1)
            plain.publish("/number_mon", *numbers(1))
            hearer.until(lambda: 1 in values(hearer.heard("/number")), lambda: "it hears nothing")
            return values(hearer.heard("/number"))

        eventually(late, lambda heard: heard == [5, 6, 1])
        for latching in (one, other):
            latching.withdraw("/number_mon")
        eventually(late, lambda heard: heard == [1])
        adapter.ends_well()


def test_another_type_than_the_spec_says_is_told_and_does_not_pass(tmp_path: Path) -> None:
    from std_msgs.msg import Int32

    with gate(tmp_path) as scene:
        adapter, speaker = scene.adapter("gate"), scene.peer()
        speaker.advertise(Int32, "/number_mon")
        speaker.publish("/number_mon", Int32(data=1))
        why = "nothing of /peer0 can be read: it publishes std_msgs/Int32, and the spec says std_msgs/Int64"
        adapter.said(f"/number: {why}")
        eventually(
            lambda: [s["trouble"] for s in scene.server.session("s")["monitors"][0]["streams"]],
            lambda told: told == [why],
        )
        assert scene.server.events("s") == []


def test_who_publishes_past_the_monitor_is_told(tmp_path: Path) -> None:
    with gate(tmp_path) as scene:
        adapter, sneak = scene.adapter("gate"), scene.peer()
        sneak.advertise(Int64, "/number", listeners=0)
        adapter.said("/number: /peer0 publishes /number past the monitor")
        sneak.withdraw("/number")
        adapter.said("/number: recovered")


def test_who_publishes_past_the_monitor_is_told_though_a_new_master_does_not_know_it(tmp_path: Path) -> None:
    with gate(tmp_path) as scene:
        adapter, rogue = scene.adapter("gate"), scene.peer()
        rogue.advertise(Int64, "/number", listeners=0)
        adapter.said("/peer0 publishes /number past the monitor")
        scene.restart_master()
        adapter.said("registered again")
        other = scene.peer()
        other.advertise(Int64, "/number", listeners=0)
        adapter.said("/peer0 publishes /number past the monitor; /peer1 publishes /number past the monitor")
        rogue.close()
        adapter.said("/number: /peer1 publishes /number past the monitor")
        assert "recovered" not in adapter.log


@pytest.mark.parametrize("intercept", ["publisher", "subscriber"])
def test_who_hears_past_the_monitor_is_told_where_nobody_hears_what_passes(intercept: str, tmp_path: Path) -> None:
    with gate(tmp_path, intercept) as scene:
        adapter, base, pilot = scene.adapter("gate"), scene.peer(), scene.peer()
        heard, given = SIDES[intercept]
        base.record(Int64, heard)
        pilot.advertise(Int64, heard, listeners=2)
        text = f"nobody hears {given}, and past the monitor hears {heard}: /peer0"
        adapter.said(f"/number: {text}")
        eventually(
            lambda: [s["trouble"] for m in scene.server.session("s")["monitors"] for s in m["streams"]], [text].__eq__
        )
        base.record(Int64, given)
        adapter.said("/number: recovered")


def test_who_subscribes_to_what_passes_and_gets_nothing_is_told(tmp_path: Path) -> None:
    with gate(tmp_path) as scene:
        adapter, odd, hearer, pilot = scene.adapter("gate"), scene.peer(), scene.peer(), scene.peer()
        odd.record(String, "/number")
        hearer.record(Int64, "/number", speakers=1)
        pilot.advertise(Int64, "/number_mon")
        adapter.said("/number: /peer0 subscribes to /number, and gets nothing of it: it asks for another type")
        pilot.publish("/number_mon", *numbers(8))
        hearer.heard("/number", 1)
        assert "/peer1 subscribes" not in adapter.log
        [trouble] = [s["trouble"] for m in scene.server.session("s")["monitors"] for s in m["streams"]]
        assert trouble.startswith("/peer0 subscribes to /number, and gets nothing")
        adapter.ends_well()


def test_who_publishes_past_a_monitor_that_ros_remaps_is_told(tmp_path: Path) -> None:
    with gate(tmp_path) as scene:
        adapter = scene.adapter("gate", more=["/number:=/uav1/number", "/number_mon:=/uav1/asked"])
        speaker, hearer = scene.peer(), scene.peer()
        hearer.record(Int64, "/uav1/number", speakers=1)
        speaker.advertise(Int64, "/uav1/asked")
        speaker.publish("/uav1/asked", *numbers(7, 8))
        assert values(hearer.heard("/uav1/number", 1)) == [8]
        speaker.advertise(Int64, "/uav1/number")
        adapter.said("/number: /peer0 publishes /uav1/number past the monitor")


def test_a_session_made_anew_is_observed_by_the_spec_of_today(tmp_path: Path) -> None:
    with gate(tmp_path) as scene:
        adapter, speaker, hearer = scene.adapter("gate"), scene.peer(), scene.peer()
        scene.server.kill()
        changed(tmp_path)
        scene.server.restart()
        adapter.said("observing 2 streams")
        hearer.record(Int64, "/number_mon", speakers=1)
        speaker.advertise(Int64, "/number")
        speaker.advertise(Int64, "/new")
        speaker.publish("/number", *numbers(7, 8))
        speaker.publish("/new", *numbers(1))
        assert values(hearer.heard("/number_mon", 1)) == [8]
        events = eventually(lambda: scene.server.events("s"), lambda found: len(found) == 3)
        assert sorted(event["stream"] for event in events) == ["/new", "/number", "/number"]
        assert "past the monitor" not in adapter.log
        adapter.ends_well()


def say_on(_: Any) -> SetBoolResponse:
    return SetBoolResponse(True, "on")


def say_nonsense(_: Any) -> SetBoolResponse:
    return SetBoolResponse(True, "nonsense")


def never_the_first(request: Any, seen: list[Any] = []) -> SetBoolResponse:  # noqa: B006 - one list a process
    seen.append(request)
    if len(seen) == 1:
        time.sleep(10**6)
    return say_on(request)


def fail(_: Any) -> SetBoolResponse:
    raise ValueError("burnt out")


def test_a_denied_request_is_an_error_with_the_propertys_name_and_reaches_nobody(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        adapter, panel, caller = scene.adapter("switch"), scene.peer(), scene.peer()
        panel.serve(SetBool, "/switch", say_on)
        answers = [caller.call(SetBool, "/switch_mon", data) for data in (True, False, True)]
        assert [(a.success, a.message) if a else error for a, error in answers] == [
            (True, "on"),
            "service [/switch_mon] responded with an error: "
            "b'service cannot process request: the oracle denied the request of /switch: only_on'",
            (True, "on"),
        ]
        assert [request.data for request in panel.reached("/switch")] == [True, True]
        assert done(settled(scene.server, 5)) == [*ALLOWED, ("request", "deny", False), *ALLOWED]
        adapter.said("denied a request of /switch.*: only_on")
        adapter.ends_well()


@pytest.mark.parametrize(
    ("answer", "told"), [(say_nonsense, "denied the response of /switch: no_nonsense"), (fail, "burnt out")]
)
def test_what_the_service_did_wrong_is_an_error_at_the_client(
    answer: Callable[[Any], Any], told: str, tmp_path: Path
) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        scene.adapter("switch")
        panel, caller = scene.peer(), scene.peer()
        panel.serve(SetBool, "/switch", answer)
        response, error = caller.call(SetBool, "/switch_mon", True)
        assert response is None
        assert told in str(error)
        assert len(panel.reached("/switch")) == 1


def test_a_service_that_is_not_there_is_an_error_at_the_client(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        scene.adapter("switch")
        panel, caller = scene.peer(), scene.peer()
        response, error = caller.call(SetBool, "/switch_mon", True)
        assert response is None
        assert "service [/switch] unavailable" in str(error)
        eventually(lambda: done(scene.server.events("s")), lambda found: found == [("request", "allow", False)])
        panel.serve(SetBool, "/switch", say_on)
        answer, _ = caller.call(SetBool, "/switch_mon", True)
        assert answer.message == "on"


def test_a_call_that_is_never_answered_holds_up_no_other(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        adapter, panel, caller = scene.adapter("switch"), scene.peer(), scene.peer()
        panel.serve(SetBool, "/switch", never_the_first)
        waiting = caller.begin(SetBool, "/switch_mon", True)
        panel.until(lambda: panel.reached("/switch"), lambda: "the first call does not arrive")
        others = [caller.begin(SetBool, "/switch_mon", True) for _ in range(3)]
        assert [caller.answer(number)[0].message for number in others] == ["on"] * 3
        assert caller.answer(waiting, wait=False) is None
        adapter.ends_well()


def test_a_proxy_that_ros_remaps_is_not_called_missing(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        adapter, sneak, caller = scene.adapter("switch", more=["/switch_mon:=/asked"]), scene.peer(), scene.peer()
        sneak.serve(SetBool, "/switch", say_on)
        answer, _ = caller.call(SetBool, "/asked", True)
        assert answer.success
        sneak.serve(SetBool, "/asked", say_on)
        adapter.said("/switch: /peer0 serves /asked in the monitor's place")
        assert "does not know" not in adapter.log


def test_another_server_in_the_place_of_the_proxy_is_told(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        adapter, sneak = scene.adapter("switch"), scene.peer()
        sneak.record(String, "/uav1/monitor_error", speakers=1)
        sneak.record(DiagnosticArray, "/diagnostics", speakers=1)
        sneak.serve(SetBool, "/switch_mon", say_on)
        text = "/peer0 serves /switch_mon in the monitor's place"
        adapter.said(f"/switch: {text}")
        sneak.until(
            lambda: (
                f"/switch: {text}" in [error.data for error in sneak.heard("/uav1/monitor_error")]
                and text in [s.message for array in sneak.heard("/diagnostics") for s in array.status]
            ),
            lambda: "it is not shown",
        )
        eventually(
            lambda: [s["trouble"] for s in scene.server.session("s")["monitors"][0]["streams"]],
            lambda told: sorted(told) == ["", text],
        )
        adapter.ends_well()
