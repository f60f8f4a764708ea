"""Messages that nobody expects, on real ROS 1."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, Self

import pytest
import rospy
from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import String

from tests.processes import eventually
from tests.robot import spec_folder
from tests.ros1.harness import Scene

SPEC = """
id: odd
description: Vectors and texts pass
ordering: {max_delay: 50ms}
streams:
  - topic: /vector
    type: geometry_msgs/Vector3
    action: filter
    intercept: publisher
    decide_within: 60s
    signals: {x: msg.x}
  - topic: /text
    type: std_msgs/String
    signals: {text: msg.data}
properties:
  - id: small
    formula: 'not {topic: "/vector", x > 100}'
    guards: [/vector]
  - id: polite
    formula: 'not {topic: "/text", text: "damn"}'
"""


def raw(data: bytes) -> rospy.AnyMsg:
    """A message that is sent as it is."""
    made = rospy.AnyMsg()
    made._buff = data
    return made


def numbers(heard: Sequence[Any]) -> list[float]:
    return [said.x for said in heard]


def test_another_type_of_the_same_definition_does_not_shut_out_the_right_one(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SPEC)) as scene:
        adapter = scene.adapter("odd")
        wrong, right, hearer = scene.peer(), scene.peer(), scene.peer()
        hearer.record(Vector3, "/vector", speakers=1)
        wrong.advertise(Point, "/vector_mon")
        wrong.publish("/vector_mon", Point(1, 2, 3))
        adapter.said("it publishes geometry_msgs/Point, and the spec says geometry_msgs/Vector3")
        right.advertise(Vector3, "/vector_mon")
        right.publish("/vector_mon", Vector3(4, 5, 6))
        assert numbers(hearer.heard("/vector", 1)) == [4]
        adapter.ends_well()


def test_a_message_that_cannot_be_read_is_told_and_lost_and_does_not_pass(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SPEC)) as scene:
        adapter = scene.adapter("odd")
        speaker, hearer = scene.peer(), scene.peer()
        hearer.record(Vector3, "/vector", speakers=1)
        speaker.advertise(Vector3, "/vector_mon")
        speaker.advertise(String, "/text")
        speaker.publish("/vector_mon", Vector3(1, 0, 0), raw(b"abc"), Vector3(2, 0, 0))
        speaker.publish("/text", String("a"), raw(b"\x10\0\0\0"), raw(b"\x04\0\0\0caf\xe9"), String("b"))
        assert numbers(hearer.heard("/vector", 2)) == [1, 2]
        counters = eventually(lambda: scene.server.session("s")["counters"], lambda c: c["lost"] + c["steps"] == 7)
        assert counters["lost"]
        adapter.said("/vector: /peer0 publishes what can't be read: ")
        adapter.ends_well()


class Odd(Vector3):  # type: ignore[misc]
    """What is not defined as it says."""

    _full_text = "float64 x\nint64 lambda\n"
    _md5sum = "0123456789abcdef0123456789abcdef"


class Odder(Vector3):  # type: ignore[misc]
    """What is no definition at all."""

    _full_text = "float64 x\n" + "=" * 80 + "\nMSG: nonsense\n\n[[["
    _md5sum = "1123456789abcdef0123456789abcdef"


@pytest.mark.parametrize("kind", [Odd, Odder])
def test_a_definition_that_can_not_be_read_is_told_and_others_are_heard(kind: Any, tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SPEC)) as scene:
        adapter = scene.adapter("odd")
        wrong, right, hearer = scene.peer(), scene.peer(), scene.peer()
        wrong.advertise(kind, "/vector_mon")
        wrong.publish("/vector_mon", kind(1, 2, 3))
        adapter.said("nothing of /peer0 can be read: ")
        hearer.record(Vector3, "/vector", speakers=1)
        right.advertise(Vector3, "/vector_mon")
        right.publish("/vector_mon", Vector3(4, 5, 6))
        assert numbers(hearer.heard("/vector", 1)) == [4]
        adapter.ends_well()


TYPELESS = """
import hashlib
import sys
import rospy
from rospy.impl.tcpros_pubsub import TCPROSPub
from std_msgs.msg import String

fields, unsaid = TCPROSPub.get_header_fields, sys.argv[1]
TCPROSPub.get_header_fields = lambda self: {k: v for k, v in fields(self).items() if k != unsaid}
rospy.init_node("typeless")
for topic in ("/text", "/vector_mon"):
    rospy.Publisher(topic, String, latch=True, queue_size=1).publish("damn")
rospy.spin()
"""


@pytest.mark.parametrize(
    ("unsaid", "why"),
    [
        ("type", "it publishes what has no type, and the spec says std_msgs/String"),
        ("md5sum", "the definition of std_msgs/String that /typeless sends is not that of its messages"),
    ],
)
def test_a_publisher_that_does_not_say_its_type_does_not_end_the_adapter(unsaid: str, why: str, tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SPEC)) as scene:
        adapter, peer = scene.adapter("odd"), scene.peer()
        scene.run("typeless", sys.executable, "-c", TYPELESS, unsaid)
        adapter.said(f"/text: nothing of /typeless can be read: {why}")
        peer.advertise(String, "/text")
        peer.publish("/text", String("damn"))
        [violation] = eventually(lambda: scene.server.records("s", "violations"), len)
        assert violation["property"] == "polite"
        adapter.ends_well()


FOREIGN = SPEC.replace("geometry_msgs/Vector3", "foreign_msgs/Vector")


class Foreign(Vector3):  # type: ignore[misc]
    """What is not installed where the adapter is."""

    _type = "foreign_msgs/Vector"


class Newer(Foreign):
    """A later version of it, in which there is more."""

    _full_text = "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
    _md5sum = hashlib.md5(_full_text.strip().encode()).hexdigest()

    def serialize(self, buffer: BytesIO) -> None:
        super().serialize(buffer)
        buffer.write(bytes(8))

    def deserialize(self, data: bytes) -> Self:
        super().deserialize(data[:24])
        return self


def test_another_version_is_forwarded_once_nobody_publishes_the_first_one(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, FOREIGN)) as scene:
        adapter, old, newer, hearer = scene.adapter("odd"), scene.peer(), scene.peer(), scene.peer()
        old.advertise(Foreign, "/vector_mon")
        old.record(Foreign, "/vector", speakers=1)
        newer.advertise(Newer, "/vector_mon")
        adapter.said("/peer1 publishes another version of foreign_msgs/Vector than is given")
        newer.publish("/vector_mon", Newer(1, 0, 0))
        old.publish("/vector_mon", Foreign(2, 0, 0))
        assert numbers(old.heard("/vector", 1)) == [2]
        old.withdraw("/vector_mon")
        adapter.said("/vector: recovered")
        hearer.record(Newer, "/vector", speakers=1)
        newer.publish("/vector_mon", Newer(3, 0, 0), Newer(1000, 0, 0), Newer(4, 0, 0))
        assert numbers(hearer.heard("/vector", 2)) == [3, 4]
        told = eventually(lambda: scene.server.events("s"), lambda found: len(found) == 4)
        assert [event["passed"] for event in told] == [True, True, False, True]
        adapter.ends_well()


def test_what_cannot_be_read_is_lost_though_no_event_of_its_topic_follows(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SPEC)) as scene:
        adapter, speaker, wrong = scene.adapter("odd"), scene.peer(), scene.peer()
        speaker.advertise(Vector3, "/vector_mon")
        wrong.advertise(Point, "/text")
        wrong.publish("/text", Point(1, 2, 3), Point(4, 5, 6))
        adapter.said("/text: nothing of /peer1 can be read: it publishes geometry_msgs/Point")

        def lost() -> Any:
            speaker.publish("/vector_mon", Vector3(1, 0, 0))
            return scene.server.session("s")["counters"]["lost"]

        eventually(lost, lambda count: count == 2)
        wrong.withdraw("/text")  # no sooner: rospy drops what it has not read of one that has gone
        adapter.said("/text: recovered")
        adapter.ends_well()
