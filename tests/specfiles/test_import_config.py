"""`import`: what a configuration says is kept, or refused with its place."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from oracle_server.core.errors import SpecError
from oracle_server.specfiles.load import parse_spec
from oracle_server.specfiles.rosmonitoring.config import read_config
from oracle_server.specfiles.rosmonitoring.draft import make_draft
from oracle_server.specfiles.rosmonitoring.write import spec_text
from tests.specfiles.test_import import imported
from tests.whole.harness import failed


def one(keys: str) -> str:
    """A configuration of one monitor."""
    return f"monitors: [{{monitor: {{id: m, {keys}}}}}]"


@pytest.mark.parametrize(
    ("oracle", "url", "timeout"),
    [
        ("{url: 10.0.0.1, port: 8081, timeout: '3.5'}", "ws://10.0.0.1:8081", "3500ms"),
        ("{url: 'ws://127.0.0.1', port: 8080}", "ws://127.0.0.1:8080", "2000ms"),
        ("{url: 'wss://judge:9000/rml', port: 8080}", "wss://judge:9000/rml", "2000ms"),
        ("{url: '[::1]', port: '81', timeout: }", "ws://[::1]:81", "2000ms"),
        ("{}", "ws://127.0.0.1:8080", "2000ms"),
    ],
)
def test_the_address_of_an_oracle_keeps_what_it_says(oracle: str, url: str, timeout: str) -> None:
    value = {"id": "m", "oracle": yaml.safe_load(oracle), "topics": [{"name": "a", "type": "std_msgs/Bool "}]}
    config = read_config({"monitors": [{"monitor": value}]}, "config.yaml")
    text = spec_text(config, make_draft(config, []), "config.yaml")
    (judge,) = parse_spec(text, "spec.yaml").spec.properties
    assert judge.external is not None
    assert (judge.external.url, config.timeout) == (url, float(timeout.removesuffix("ms")) / 1000)


def test_an_address_with_two_schemes_is_refused() -> None:
    spec = "id: x\nstreams: [{topic: /a}]\nproperties: [{id: p, engine: external, url: 'ws://ws://127.0.0.1:8080'}]\n"
    with pytest.raises(SpecError, match="has two schemes"):
        parse_spec(spec, "spec.yaml")


def test_what_several_places_say_of_an_interface_is_put_together(tmp_path: Path) -> None:
    config = """
nodes: [{node: {name: x, package: p, name: y, package: p}}]
defaults: &defaults {type: std_msgs/String, action: log}
monitors:
  - monitor:
      id: m
      oracle: {port: 8080, url: 127.0.0.1, action: nothing}
      topics:
        - {name: a, type: std_msgs.msg.String, action: log, publishers: [x]}
        - {name: /a, <<: *defaults, action: filter, subscribers: [x], ordering: {max_delay_ms: 70}}
      actions:
        - {name: dock, event_kind: [feedback]}
  - monitor:
      id: n
      oracle: {port: 8081, url: 127.0.0.1, action: nothing}
      topics:
        - {name: a, warning: 2, type: std_msgs/msg/String, action: filter, publishers: [x]}
        - {name: b, type: std_msgs/String, ordering: {order_by: stamp, max_delay_ms: 0.5}}
      actions:
        - {name: dock, action: filter, event_kind: [start_action_request, start]}
      ordered_topics: [/b, c]
"""
    text, spec = imported(tmp_path, config)
    streams = {(stream.name, stream.kind): stream for stream in spec.streams}
    assert streams.keys() == {("/a", "topic"), ("/b", "topic"), ("/dock", "goal"), ("/dock", "feedback")}
    assert (streams["/a", "topic"].action, streams["/a", "topic"].intercept) == ("filter", "subscriber")
    assert streams["/dock", "goal"].action == "filter"
    assert "  max_delay: 70ms\n" in text
    for lost in ("filtered by monitor 'n' for its publishers, too", "`warning`", "`max_delay_ms: 0.5`",
                 "`event_kind: start`", "`ordered_topics` of monitor 'n': /c is none of its topics"):  # fmt: skip
        assert f"# no counterpart: {lost}" in text


@pytest.mark.parametrize(
    ("config", "word"),
    [
        ("a: b", "the list `monitors` is missing"),
        ("monitors: [5]", "monitors[0] is not a mapping"),
        ("monitors: [{monitor: {id: x}}]", "has no topics, services or actions"),
        ("monitors: [{monitor: {topics: [{type: x}]}}]", "has no name"),
        ("a: [", "not YAML"),
        (one("topics: [{name: a}, /b, c]"), "topics[1] of monitor 'm' is '/b'; write what it is, as in `{name: "),
        (
            one("topics: [{name: a, type: String}]"),
            "topic a of monitor 'm': `type: String` is no name of a type; write",
        ),
        (one("topics: [{name: a, type: [1]}]"), "`type: [1]` is no name of a type"),
        (one("topics: [{name: a, type: 'x.msg.S # y'}]"), "`type: x.msg.S # y` is no name of a type"),
        (one("oracle: {timeout: 2s}, topics: [{name: a}]"), "the oracle of monitor 'm': `timeout: 2s` is no number of"),
        (one("oracle: {timeout: none}, topics: [{name: a}]"), "`timeout: none` is no number of seconds"),
        (one("oracle: {timeout: .inf}, topics: [{name: a}]"), "`timeout: inf` is no number of seconds"),
        (one("oracle: {timeout: -1}, topics: [{name: a}]"), "`timeout: -1` is no number of seconds"),
        (one("oracle: {timeout: [2]}, topics: [{name: a}]"), "`timeout: [2]` is no number of seconds"),
        (one("oracle: {port: 80a}, topics: [{name: a}]"), "`port: 80a` is no number from 1 to 65535"),
        (one("oracle: {url: '[::1', port: 80}, topics: [{name: a}]"), "`url: [::1` can't be read"),
        (one("oracle: 127.0.0.1, topics: [{name: a}]"), "the oracle of monitor 'm' is no mapping"),
        (one("topics: 5"), "`topics` of monitor 'm' is no list"),
        (one("topics: [{name: a}], services: {name: x, action: filter}"), "`services` of monitor 'm' is no list"),
        (one("topics: [{name: a}], ordered_topics: {a: 1}"), "`ordered_topics` of monitor 'm' is no list"),
        (one("topics: [{name: a}], ordered_topics: [1]"), "ordered_topics[0] of monitor 'm' has no name"),
        (one("topics: [{name: [a], action: filter}]"), "has no name, or one that ROS does not allow: ['a']"),
        (one("topics: [{name: a, action: Filter}]"), "topic a of monitor 'm': `action: Filter` is neither `log` nor"),
        (one("topics: [{name: a, ordering: 5}]"), "topic a of monitor 'm': `ordering` is no mapping"),
        (
            one("\n  topics: [{name: a, action: filter}],\n  topics: [{name: b}]"),
            "config.yaml: line 3: `topics` stands twice in one mapping",
        ),
        (
            "monitors: [{id: m, topics: [{name: a, type: std_msgs.msg.String}]},"
            " {id: n, topics: [{name: /a, type: std_msgs/Int32, action: filter}]}]",
            "topic /a of monitor 'n' has the type std_msgs/msg/Int32, and std_msgs/msg/String before",
        ),
    ],
)
def test_what_is_no_configuration_is_refused_in_one_line(tmp_path: Path, config: str, word: str) -> None:
    (tmp_path / "config.yaml").write_text(config)
    assert word in failed("import", tmp_path / "config.yaml")


def test_a_topic_of_a_services_events_is_kept_with_its_type(tmp_path: Path) -> None:
    module = """
PROPERTY = "historically(not {on})"
predicates = dict(time=0, on=False)


def abstract_message(message):
    if "topic" in message and "SetBool" in message["topic"]:
        predicates["on"] = len(message["request"]) > 0 and message["request"][0]["data"]
    predicates["time"] = message["time"]
    return predicates
"""
    config = one("topics: [{name: /SetBool/_service_event, type: std_srvs.srv.SetBool_Event, action: log}]")
    text, _ = imported(tmp_path, config, never=module)
    (stream,) = parse_spec(text, "spec.yaml").spec.streams
    assert stream.type == "std_srvs/srv/SetBool_Event"
    assert "msg.request[0].data" in text
