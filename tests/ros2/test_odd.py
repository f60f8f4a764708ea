"""Messages that nobody expects, on real ROS 2: what can't be read, and what is no text."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import pytest

from tests.robot import spec_folder
from tests.ros2.harness import Scene, eventually

msg = pytest.importorskip("std_msgs.msg")
test_msgs = pytest.importorskip("test_msgs.msg")
serialization = pytest.importorskip("rclpy.serialization")

# rclpy imports an old lark with its first node, and warns by a function of its own that is deprecated.
pytestmark = pytest.mark.filterwarnings(
    "ignore:module 'sre_:DeprecationWarning", "ignore:Deprecated in favor of:DeprecationWarning"
)

TEXTS = """
id: texts
description: Texts pass, but for the forbidden one
ordering: {max_delay: 50ms}
streams:
  - topic: /text
    type: std_msgs/msg/String
    action: filter
    intercept: publisher
    decide_within: 60s
    signals: {forbidden: msg.data == 'forbidden'}
  - topic: /wide
    type: test_msgs/msg/WStrings
    signals: {wide: msg.wstring_value}
properties:
  - id: nothing_forbidden
    formula: 'not {topic: "/text", forbidden}'
    guards: [/text]
  - id: nothing_wide
    formula: 'not {topic: "/wide", wide: "forbidden"}'
"""
CELLS = """
id: cells
streams:
  - topic: /cells
    type: std_msgs/msg/Int8MultiArray
    action: filter
    intercept: publisher
    on_unavailable: pass
    decide_within: 60s
    signals: {first: 'msg.data[0]'}
properties:
  - {id: free, formula: 'not {first: 100}', guards: [/cells]}
"""
LITTLE_ENDIAN = b"\x00\x01\x00\x00"


def text(data: bytes) -> bytes:
    """A serialized `std_msgs/String` with any bytes in it."""
    return LITTLE_ENDIAN + struct.pack("<I", len(data) + 1) + data + b"\0"


def gate(folder: Path) -> Scene:
    return Scene(folder, spec_folder(folder, TEXTS))


def test_what_is_forwarded_is_what_came_byte_for_byte(tmp_path: Path) -> None:
    data = b"caf\xe9"
    with gate(tmp_path) as scene:
        adapter, peer = scene.adapter("texts"), scene.peer()
        heard: list[bytes] = []
        peer.node.create_subscription(msg.String, "/text", heard.append, 10, raw=True)
        publisher = peer.publisher(msg.String, "/text_mon")
        peer.until(lambda: peer.node.count_publishers("/text") == 1)
        publisher.publish(text(data))
        peer.until(lambda: heard)
        assert data in heard[0]
        adapter.ends_well()


def test_a_message_that_cannot_be_read_is_told_and_lost_and_does_not_pass(tmp_path: Path) -> None:
    with gate(tmp_path) as scene:
        adapter, peer = scene.adapter("texts"), scene.peer()
        heard = peer.record(msg.String, "/text")
        texts, wide = peer.publisher(msg.String, "/text_mon"), peer.publisher(test_msgs.WStrings, "/wide")
        peer.until(lambda: peer.node.count_publishers("/text") == 1)
        good = test_msgs.WStrings(wstring_value="good")
        whole = serialization.serialize_message(test_msgs.WStrings(wstring_value="XYZ"))
        no_text = whole.replace("Y".encode("utf-16-le"), b"\x00\xd8")  # half a surrogate pair
        too_long = LITTLE_ENDIAN + b"\xff\xff\xff\x7fa"
        hidden = text(b"allowed\0forbidden")  # rclpy reads the half of it
        other = b"\x00\x07" + hidden[2:]  # and so in a form that no ROS node writes
        for publisher, messages in (
            (texts, (msg.String(data="a"), too_long, hidden, other, msg.String(data="b"))),
            (wide, (good, no_text, good)),
        ):
            for message in messages:
                publisher.publish(message)
        peer.until(lambda: len(heard) == 2)
        assert [said.data for said in heard] == ["a", "b"]
        eventually(lambda: len(scene.server.events("s")), lambda count: count == 4)
        assert scene.server.session("s")["counters"]["lost"] == 4
        for stream in ("/text", "/wide"):
            adapter.said(f"{stream}: /peer publishes what can't be read: ")
        adapter.ends_well()


def test_what_cannot_be_read_is_lost_though_no_event_of_its_topic_follows(tmp_path: Path) -> None:
    with gate(tmp_path) as scene:
        adapter, speaker, wrong = scene.adapter("texts"), scene.peer("speaker"), scene.peer("wrong")
        texts, wide = speaker.publisher(msg.String, "/text_mon"), wrong.publisher(test_msgs.WStrings, "/wide")
        for _ in range(2):
            wide.publish(LITTLE_ENDIAN + b"\xff\xff\xff\x7fa")
        adapter.said("/wide: /wrong publishes what can't be read: ")
        wrong.node.destroy_publisher(wide)
        adapter.said("/wide: a publisher that has ended has published what can't be read: ")
        eventually(
            lambda: scene.server.session("s"), lambda found: "a publisher that has ended" in str(found["monitors"])
        )

        def lost() -> Any:
            texts.publish(msg.String(data="a"))
            return scene.server.session("s")["counters"]["lost"]

        eventually(lost, lambda count: count == 2)
        adapter.said("/wide: recovered")
        adapter.ends_well()


def test_a_list_that_no_frame_holds_does_not_pass_and_is_told(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, CELLS)) as scene:
        adapter, peer = scene.adapter("cells"), scene.peer()
        heard = peer.record(msg.Int8MultiArray, "/cells")
        cells = peer.publisher(msg.Int8MultiArray, "/cells_mon")
        peer.until(lambda: peer.node.count_publishers("/cells") == 1)
        for count in (2**20, 2):
            cells.publish(msg.Int8MultiArray(data=[0] * count))
        peer.until(lambda: heard)
        assert len(heard[0].data) == 2
        adapter.said('denied a message of /cells: an event of "/cells" is too large for a frame')
        eventually(lambda: len(scene.server.events("s")), lambda count: count == 1)
        assert scene.server.session("s")["counters"]["lost"] == 1
        adapter.ends_well()
