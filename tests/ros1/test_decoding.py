"""What a topic's messages become, by what their publishers say of them."""

from __future__ import annotations

import io
from typing import Any

import genpy.dynamic
import rospy
from oracle_ros1.observed import Decoder, Observed

NOW = 5


def observed(type_: str, fields: list[str] | None, frame: int | None = None) -> Observed:
    stream = {"name": "/a", "kind": "topic", "type": type_, "fields": fields, "stamp": None, "latency": 7}
    return Observed(stream, lambda: NOW, frame)


def header(kind: Any, node: str, **more: str) -> dict[str, str]:
    """What a publisher says as it connects."""
    told = {"type": kind._type, "md5sum": kind._md5sum, "message_definition": kind._full_text, "callerid": node}
    return {**told, **more}


def taken(topic: Observed, message: Any, told: dict[str, str]) -> tuple[Any, Any, int] | None:
    """The event of a message, None where there is none."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    came = rospy.AnyMsg()
    came._buff, came._connection_header = buffer.getvalue(), told
    decoder = topic.decoder(told)
    if isinstance(decoder, Decoder):
        return topic.event(came, decoder)
    topic.refuse(told, decoder)
    return None


def test_a_definition_that_can_not_be_read_shuts_out_nobody_else_and_its_messages_are_lost() -> None:
    kind = genpy.dynamic.generate_dynamic("foreign_msgs/Move", "float64 v\n")["foreign_msgs/Move"]
    topic = observed("foreign_msgs/msg/Move", ["v"])
    bad, good = header(kind, "/bad", message_definition="[[["), header(kind, "/good")
    assert taken(topic, kind(1.0), bad) is None
    assert taken(topic, kind(2.0), bad) is None
    [why] = topic.troubles([bad])
    assert why.startswith("nothing of /bad can be read: ")
    assert taken(topic, kind(3.0), good) == (topic._now, {"v": 3.0}, 2)
    assert topic.troubles([bad, good]) == []  # the good one has said what is in such messages
    assert taken(topic, kind(4.0), bad) == (topic._now, {"v": 4.0}, 0)


def test_times_come_from_a_field_where_a_version_that_is_published_has_one() -> None:
    from std_msgs.msg import Float64, Header

    text = "Header header\nfloat64 data\n" + "=" * 80 + "\nMSG: std_msgs/Header\n" + Header._full_text
    newer = genpy.dynamic.generate_dynamic("std_msgs/Float64", text)["std_msgs/Float64"]
    topic = observed("std_msgs/msg/Float64", ["data"])
    assert taken(topic, Float64(1.0), header(Float64, "/old")) == (topic._now, {"data": 1.0}, 0)
    assert (topic.time_source, topic.latency) == ("arrival", None)
    stamped = newer(header=Header(stamp=genpy.Time(3)), data=2.0)
    assert taken(topic, stamped, header(newer, "/new")) == (3 * 10**9, {"data": 2.0}, 0)
    assert (topic.time_source, topic.latency) == ("field", 7)


def test_what_rospy_has_decoded_already_is_read() -> None:
    from rosgraph_msgs.msg import Clock

    topic, told = observed("rosgraph_msgs/msg/Clock", ["clock.sec"]), header(Clock, "/world")
    decoder = topic.decoder(told)
    assert isinstance(decoder, Decoder)
    clock = Clock(rospy.Time(7))
    clock._connection_header = told
    assert topic.event(clock, decoder) == (topic._now, {"clock": {"sec": 7}}, 0)


def test_what_a_node_that_has_gone_published_is_told_once() -> None:
    from std_msgs.msg import Float64, Int32

    topic, wrong = observed("std_msgs/msg/Float64", []), header(Int32, "/wrong")
    assert taken(topic, Int32(1), wrong) is None
    told = ["nothing of /wrong can be read: it publishes std_msgs/Int32, and the spec says std_msgs/Float64"]
    assert (topic.troubles([]), topic.troubles([])) == (told, [])
    assert taken(topic, Float64(1.0), header(Float64, "/right")) == (topic._now, {}, 1)
