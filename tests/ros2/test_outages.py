"""An oracle that is frozen for seconds, and messages that come fast, on real ROS 2."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.robot import FAST, GATE_AND_LOG, SWITCH, changed, settled, spec_folder
from tests.ros2.harness import Process, Scene, eventually, without_gaps

msg = pytest.importorskip("std_msgs.msg")
srv = pytest.importorskip("std_srvs.srv")
QoSProfile = pytest.importorskip("rclpy.qos").QoSProfile
Duration = pytest.importorskip("rclpy.duration").Duration

# rclpy imports an old lark with its first node, and warns by a function of its own that is deprecated.
pytestmark = pytest.mark.filterwarnings(
    "ignore:module 'sre_:DeprecationWarning", "ignore:Deprecated in favor of:DeprecationWarning"
)

FROZEN = 5.0
"""Seconds without the oracle."""
AHEAD = 500
"""Messages that may be on their way: the adapter's subscription keeps twice as many, if this machine lets it wait."""


@contextmanager
def gate(folder: Path, unavailable: str, within: str) -> Iterator[tuple[Scene, Process]]:
    specs = spec_folder(folder, GATE_AND_LOG, intercept="publisher", unavailable=unavailable, within=within)
    with Scene(folder, specs) as scene:
        yield scene, scene.adapter("gate")


def values(heard: list[Any]) -> list[int]:
    return [said.data for said in heard]


@pytest.mark.parametrize("unavailable", ["deny", "pass"])
def test_a_frozen_oracle_is_done_without_as_the_spec_says_and_catches_up(unavailable: str, tmp_path: Path) -> None:
    with gate(tmp_path, unavailable, "1500ms") as (scene, adapter):
        peer = scene.peer()
        heard = peer.record(msg.Int64, "/number")
        numbers, logged = peer.publisher(msg.Int64, "/number_mon"), peer.publisher(msg.Int64, "/logged")
        peer.until(lambda: peer.node.count_publishers("/number") == 1)
        count = 0

        def publish() -> None:
            nonlocal count
            count += 1
            numbers.publish(msg.Int64(data=count))
            logged.publish(msg.Int64(data=count))

        scene.server.process.send(signal.SIGSTOP)
        end = time.monotonic() + FROZEN
        while time.monotonic() < end:
            publish()
            after = time.monotonic() + 0.05
            peer.until(lambda after=after: time.monotonic() > after)
        without = count
        adapter.said("passed a message|denied a message")
        if unavailable == "pass":
            peer.until(lambda: len(heard) == without, "not all passed")
            assert values(heard) == list(range(1, without + 1)), "sevens pass too, and the order is kept"
        scene.server.process.send(signal.SIGCONT)
        adapter.said("the oracle is back after")

        # Decided again: all but the sevens.
        eventually(lambda: len(scene.server.events("s")), lambda found: found == 2 * without)
        while count % 7 != 6:
            publish()
        publish()
        publish()
        peer.until(lambda: values(heard)[-1:] == [count])
        assert count - 1 not in values(heard)[without:]
        events = eventually(lambda: scene.server.events("s"), lambda found: len(found) == 2 * count)
        assert without_gaps([event["seq"] for event in events])
        asked = sorted(settled(scene.server, count, stream="/number"), key=lambda event: event["seq"])
        policy = unavailable == "pass"
        for event in asked:  # those of the last moments were decided on in time
            undecided = event["kind"] == "unavailable"
            assert event["passed"] == (policy if undecided else event["decision"] == "allow")
        assert sum(event["kind"] == "unavailable" for event in asked) > 1
        assert values(heard) == [number for number, event in enumerate(asked, start=1) if event["passed"]]
        assert scene.server.session("s")["counters"]["lost"] == 0
        adapter.ends_well()
        assert adapter.log.count("until the oracle is back") == adapter.log.count("the oracle is back after")


def test_calls_that_wait_for_a_frozen_oracle_are_all_answered(tmp_path: Path) -> None:
    """They may all go at once then, and a service keeps ten."""
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        peer = scene.peer()
        peer.node.create_service(srv.SetBool, "/switch", lambda _, response: response)
        scene.adapter("switch")
        client = peer.node.create_client(srv.SetBool, "/switch_mon", qos_profile=QoSProfile(depth=1000))
        peer.until(client.service_is_ready, "nobody serves /switch_mon")
        scene.server.process.send(signal.SIGSTOP)
        answers = [client.call_async(srv.SetBool.Request(data=True)) for _ in range(40)]
        asked = time.monotonic() + 0.5
        peer.until(lambda: time.monotonic() > asked)
        assert not any(answer.done() for answer in answers)
        scene.server.process.send(signal.SIGCONT)
        peer.until(lambda: all(answer.done() for answer in answers), "calls are lost")


def test_a_session_that_is_made_anew_by_a_changed_spec_is_observed_as_that_says(tmp_path: Path) -> None:
    with gate(tmp_path, "deny", "60s") as (scene, adapter):
        adapter.said("observing 2 streams")
        peer = scene.peer()
        scene.server.kill()
        changed(tmp_path)
        scene.server.restart()
        adapter.said("observing 3 streams")
        heard = peer.record(msg.Int64, "/number_mon")
        number, new = peer.publisher(msg.Int64, "/number"), peer.publisher(msg.Int64, "/new")
        peer.until(lambda: peer.node.count_publishers("/number_mon") == 1)
        peer.until(lambda: peer.node.count_publishers("/number") == 1)
        number.publish(msg.Int64(data=7))
        number.publish(msg.Int64(data=8))
        new.publish(msg.Int64(data=1))
        peer.until(lambda: heard)
        assert values(heard) == [8]
        events = eventually(lambda: scene.server.events("s"), lambda found: len(found) == 3)
        assert sorted(event["stream"] for event in events) == ["/new", "/number", "/number"]
        adapter.ends_well()


def test_a_filtered_topic_at_1_khz_keeps_all_in_order(tmp_path: Path) -> None:
    with gate(tmp_path, "deny", "60s") as (scene, adapter):
        peer = scene.peer()
        heard = peer.record(msg.Int64, "/number")
        publisher = peer.publisher(msg.Int64, "/number_mon")
        peer.until(lambda: peer.node.count_publishers("/number") == 1)

        over = threading.Event()

        def publish() -> None:
            due = time.monotonic()
            for number in range(1, FAST + 1):
                publisher.publish(msg.Int64(data=number))
                due += 0.001
                time.sleep(max(0.0, due - time.monotonic()))
                while number - len(heard) * 7 // 6 > AHEAD and not over.wait(0.001):
                    pass

        allowed = [number for number in range(1, FAST + 1) if number % 7]
        publishing = threading.Thread(target=publish)
        publishing.start()
        try:
            peer.until(lambda: len(heard) >= len(allowed), "not all has come")
        finally:
            over.set()
            publishing.join()
        assert values(heard) == allowed
        events = eventually(lambda: scene.server.events("s"), lambda found: len(found) >= FAST)
        assert without_gaps([event["seq"] for event in events])
        counters = scene.server.session("s")["counters"]
        assert (counters["lost"], counters["late"]) == (0, 0)
        adapter.ends_well()


def test_what_was_lost_on_the_way_is_counted_and_what_comes_after_is_degraded(tmp_path: Path) -> None:
    with gate(tmp_path, "deny", "60s") as (scene, adapter):
        peer = scene.peer()
        publisher = peer.publisher(msg.Int64, "/logged", qos=10)  # it keeps ten for those who are slow
        publisher.publish(msg.Int64(data=0))
        [before] = eventually(lambda: scene.server.events("s"), lambda found: found)
        adapter.send(signal.SIGSTOP)
        for number in range(1, FAST + 1):
            publisher.publish(msg.Int64(data=number))
        adapter.send(signal.SIGCONT)
        lost = eventually(
            lambda: scene.server.session("s")["counters"]["lost"],
            lambda lost: lost + len(scene.server.events("s")) == FAST + 1,
        )
        assert lost
        last = scene.server.events("s")[-1]
        assert (before["degraded"], last["degraded"]) == (False, True)
        adapter.ends_well()


@pytest.mark.parametrize("lifespan", [100, 10**6], ids=["over", "not over"])
def test_what_its_publisher_takes_for_too_old_does_not_pass_after_an_outage(lifespan: int, tmp_path: Path) -> None:
    with gate(tmp_path, "pass", "1500ms") as (scene, adapter):
        peer = scene.peer()
        heard = peer.record(msg.Int64, "/number")
        profile = QoSProfile(depth=10, lifespan=Duration(nanoseconds=lifespan * 10**6))
        numbers = peer.publisher(msg.Int64, "/number_mon", qos=profile)
        peer.until(lambda: peer.node.count_publishers("/number") == 1)
        scene.server.process.send(signal.SIGSTOP)
        numbers.publish(msg.Int64(data=1))
        if lifespan == 100:
            adapter.said("a message of /number could not be passed on: ExpiredError")
        else:
            peer.until(lambda: heard)
        scene.server.process.send(signal.SIGCONT)
        told = eventually(lambda: scene.server.events("s"), len)
        assert [event["passed"] for event in told] == [lifespan != 100]
        assert len(heard) == (lifespan != 100)
        adapter.ends_well()
