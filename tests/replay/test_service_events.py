"""Service events in bags are the requests and responses of their service."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from tests.replay.judging import BASE, MS, Judgement, judge, write_spec

SRV = "int64 a\nint64 b\n---\nint64 sum\n"
EVENT = "sums/srv/Add_Event"
ASKED, GOT, ANSWERED, HEARD = range(4)
"""Request sent and received, response sent and received."""
SPEC = """
id: adding
ordering: {{by: arrival}}
streams:
  - service: /add
    type: sums/srv/Add
    {more}
    request: {{signals: {{a: msg.a, b: msg.b}}}}
    response: {{signals: {{sum: msg.sum}}}}
  - {{topic: /y, type: std_msgs/msg/Float64, signals: {{y: msg.data}}}}
properties:
  - id: asked_before
    formula: >-
      forall[c]. {{service: "/add", kind: "response", call: *c}} -> once {{service: "/add", kind: "request", call: *c}}
  - {{id: small, formula: '{{service: "/add", kind: "request"}} -> {{a <= 5}}'{guards}}}
"""
PLAIN = SPEC.format(more="action: log", guards="")
FILTERED = SPEC.format(more="action: filter", guards=", guards: [/add]")
Row = tuple[str, int, int, int, dict[str, int] | None, dict[str, int] | None]
"""Service, event type, client, sequence number, request and response."""


def types() -> tuple[Typestore, str]:
    store = get_typestore(Stores.ROS2_HUMBLE)
    found: dict[str, Any] = {}
    info = "uint8 event_type\nbuiltin_interfaces/Time stamp\nuint8[16] client_gid\nint64 sequence_number\n"
    request, response = SRV.split("---\n")
    texts = {
        "service_msgs/msg/ServiceEventInfo": info,
        "sums/msg/Request": request,
        "sums/msg/Response": response,
        "sums/msg/Event": (
            "service_msgs/ServiceEventInfo info\nsums/Request[<=1] request\nsums/Response[<=1] response\n"
        ),
    }
    for name, text in texts.items():
        found |= get_types_from_msg(text, name)
    store.register(found)
    return store, "sums/msg/Event"


def write(path: Path, rows: list[Row], storage: StoragePlugin, definition: str = SRV) -> Path:
    """A bag with service events, and an unknown type beside them, as ROS 2 records them."""
    store, name = types()
    of = store.types
    with Writer2(path, version=9, storage_plugin=storage) as writer:
        topics = {row[0] for row in rows}
        ids = {
            t: writer.add_connection(f"{t}/_service_event", EVENT, msgdef=definition, rihs01="RIHS01_00")
            for t in topics
        }
        odd = writer.add_connection("/odd", "odd_msgs/msg/Odd", msgdef="other_msgs/Unknown x\n", rihs01="RIHS01_01")
        writer.write(odd, BASE, b"\x00\x01\x00\x00rubbish")
        y = writer.add_connection("/y", "std_msgs/msg/Float64", typestore=store)
        writer.write(y, BASE, store.serialize_cdr(of["std_msgs/msg/Float64"](data=1.0), "std_msgs/msg/Float64"))
        for number, (topic, kind, client, sequence, request, response) in enumerate(rows, start=1):
            at = BASE + number * 10 * MS
            stamp = of["builtin_interfaces/msg/Time"](sec=at // 10**9, nanosec=at % 10**9)
            gid = np.array([client] * 16, dtype=np.uint8)
            event = of["sums/msg/Event"](
                info=of["service_msgs/msg/ServiceEventInfo"](
                    event_type=kind, stamp=stamp, client_gid=gid, sequence_number=sequence
                ),
                request=[of["sums/msg/Request"](**request)] if request else [],
                response=[of["sums/msg/Response"](**response)] if response else [],
            )
            writer.write(ids[topic], at + MS, store.serialize_cdr(event, name))
    return path


def call(topic: str, sequence: int, a: int, sides: str = "both", client: int = 1) -> list[Row]:
    request, response = {"a": a, "b": 1}, {"sum": a + 1}
    kinds = {"both": (ASKED, GOT, ANSWERED, HEARD), "server": (GOT, ANSWERED), "client": (ASKED, HEARD)}[sides]
    return [
        (topic, k, client + 7 * (k in (GOT, ANSWERED)), sequence, *((request, None) if k < 2 else (None, response)))
        for k in kinds
    ]


def calls(found: Judgement) -> list[tuple[str, object]]:
    return [(row["kind"], row["stamp"]) for row in found.rows if row["property"] == "small" and row["stream"] == "/add"]


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("sides", ["both", "server", "client"])
def test_each_call_is_one_request_and_one_response(sides: str, storage: StoragePlugin, tmp_path: Path) -> None:
    rows = call("/add", 1, 3, sides) + call("/add", 2, 9, sides) + call("/add", 1, 4, sides, client=2)
    found = judge(write_spec(tmp_path, PLAIN), write(tmp_path / "bag", rows, storage))
    assert [kind for kind, _ in calls(found)] == ["request", "response"] * 3
    assert found.summary["events"] == 7, "with that of a topic, beside one whose type nobody knows"
    assert found.summary["streams"]["/add requests"]["signals"]["a"]["present"] == 3
    assert found.summary["streams"]["/add responses"]["signals"]["sum"]["present"] == 3
    states = found.summary["properties"]
    assert states["asked_before"]["violations"] == 0, "calls have numbers that their halves share"
    assert states["small"]["violations"] == 1
    first = 2 if sides == "both" else 1
    assert calls(found)[0][1] == BASE + first * 10 * MS, "stamped by the side that is taken"


def test_contents_that_were_not_recorded_are_unknown_and_it_is_said(tmp_path: Path) -> None:
    rows: list[Row] = [("/add", GOT, 1, 1, None, None), ("/add", ANSWERED, 1, 1, None, None)]
    found = judge(write_spec(tmp_path, PLAIN), write(tmp_path / "bag", rows, StoragePlugin.MCAP))
    assert found.summary["properties"]["small"]["unknown"] == 1
    assert "/add/_service_event: 2 service events without content: only metadata was recorded" in found.said
    assert (found.exit, found.strict) == (3, 3)


def test_a_filtered_service_is_judged_by_what_was_asked_of_its_proxy(tmp_path: Path) -> None:
    rows = [*call("/add_mon", 1, 3, "server"), *call("/add", 5, 3, "server"), *call("/add_mon", 2, 9, "server")]
    found = judge(write_spec(tmp_path, FILTERED), write(tmp_path / "bag", rows, StoragePlugin.MCAP))
    asked = [row for row in found.rows if row["kind"] == "request" and row["property"] == "small"]
    assert [(row["decision"], row["passed"]) for row in asked] == [("allow", True), ("deny", False)]
    assert [kind for kind, _ in calls(found)] == ["request", "response", "request"], "a denied request has no response"


def test_events_are_messages_where_the_spec_has_their_topic(tmp_path: Path) -> None:
    spec = """
id: adding
ordering: {by: arrival}
streams:
  - topic: /add/_service_event
    type: sums/srv/Add_Event
    stamp: info.stamp
    signals: {asked: msg.info.event_type == 1, a: "size(msg.request) > 0 ? msg.request[0].a : 0"}
properties:
  - {id: small, formula: '{asked} -> {a <= 5}'}
"""
    rows = call("/add", 1, 3) + call("/add", 2, 9)
    found = judge(write_spec(tmp_path, spec), write(tmp_path / "bag", rows, StoragePlugin.MCAP))
    assert found.summary["events"] == len(rows)
    assert (found.summary["properties"]["small"]["violations"], found.summary["properties"]["small"]["unknown"]) == (
        1,
        0,
    )
    assert (found.exit, found.strict) == (1, 1)


def test_an_event_whose_definition_is_unknown_is_told(tmp_path: Path) -> None:
    bag = write(tmp_path / "bag", call("/add", 1, 3), StoragePlugin.MCAP, definition="Odd x\n---\n")
    found = judge(write_spec(tmp_path, PLAIN), bag)
    assert (found.exit, "--types" in found.said) == (2, True)
