"""The messages of services and actions: passed on as they came, and decoded as far as anything reads them."""

from __future__ import annotations

from io import BytesIO
from types import SimpleNamespace
from typing import Any

import genpy.dynamic
import pytest
import rospy
from nav_msgs.msg import GetMapActionResult
from nav_msgs.srv import GetMap, GetMapRequest, GetMapResponse
from oracle_adapter import dumps
from oracle_ros1.actionmessages import ActionStream, ActionTypes
from oracle_ros1.definitions import lookup_installed
from oracle_ros1.layout import screener
from oracle_ros1.sent import Sent, as_sent, sent

from tests.ros1.test_codec import raw

FRAME = 2**20


def passing(service: Any, fields: list[str] | None) -> Any:
    """A service's type of which these fields of both messages are read."""
    kinds = service._request_class, service._response_class
    return as_sent(service, *(screener(kind, fields, lookup_installed, FRAME) for kind in kinds))


@pytest.mark.parametrize(
    ("fields", "large"), [(["map.info.width"], False), (["map.info.width", "map.data"], True), (None, True)]
)
def test_a_map_in_a_response_is_not_decoded_where_nothing_reads_it_or_no_frame_holds_it(
    fields: list[str] | None, large: bool
) -> None:
    answer = GetMapResponse()
    answer.map.info.width, answer.map.data = 1000, [7] * 1_000_000
    came = raw(answer)
    response = passing(GetMap, fields)._response_class().deserialize(came)
    assert (response.map.info.width, len(response.map.data)) == (1000, 0)
    assert sent(response) == Sent(came, "", large)
    given = BytesIO()
    response.serialize(given)
    assert given.getvalue() == came


@pytest.mark.parametrize(
    ("fields", "read", "large"),
    [
        (["map.info.width"], {"map": {"info": {"width": 1000}}}, False),
        ([], {}, False),
        (["map.data"], None, True),
        (None, None, True),
    ],
)
def test_a_map_in_a_result_is_not_decoded_where_nothing_reads_it_or_no_frame_holds_it(
    fields: list[str] | None, read: Any, large: bool
) -> None:
    answer, message = GetMapActionResult(), rospy.AnyMsg()
    answer.status.goal_id.id, answer.result.map.info.width = "one", 1000
    answer.result.map.data = [7] * 1_000_000
    message._connection_header = {"type": answer._type, "md5sum": answer._md5sum}
    message._buff = raw(answer)
    stream = {"name": "/map", "kind": "result", "type": "nav_msgs/GetMap", "action": "log", "stamp": None, "latency": 0}
    types = ActionTypes("nav_msgs/action/GetMap", {"result": stream | {"fields": fields}}, FRAME)
    shared: Any = SimpleNamespace(now=lambda: 1, frame=FRAME)
    made = ActionStream(shared, stream | {"fields": fields}, types, proxied=True)
    result = types.decoded("result", message)
    assert (result.status.goal_id.id, len(result.result.map.data)) == ("one", 0)
    data = made.data(result, result.result)
    assert len(dumps(data)) > FRAME if large else data == read


def test_what_is_known_of_a_message_is_none_of_its_fields() -> None:
    class Letter(GetMap):  # type: ignore[misc]
        _response_class = genpy.dynamic.generate_dynamic("post/Letter", "bool sent\nint32 unread\nbool is_too_long")[
            "post/Letter"
        ]

    response = passing(Letter, None)._response_class().deserialize(b"\1\5\0\0\0\0")
    assert (response.sent, response.unread, response.is_too_long) == (True, 5, False)
    assert sent(response) == Sent(b"\1\5\0\0\0\0")
    assert raw(response) == b"\1\5\0\0\0\0"


def test_why_a_message_cannot_be_read_is_known() -> None:
    response = passing(GetMap, None)._response_class().deserialize(b"\1")
    assert sent(response).unread
    assert not sent(passing(GetMap, None)._request_class().deserialize(raw(GetMapRequest()))).unread
