"""Specs that the tests on ROS judge by, and what is asked about their histories."""

from __future__ import annotations

import os
from pathlib import Path

from tests.processes import Data, Server, eventually

GATE = """
id: gate
description: Numbers pass, but for multiples of 7
ordering: {max_delay: 50ms}
streams:
  - topic: /number
    type: std_msgs/Int64
    action: filter
    intercept: INTERCEPT
    on_unavailable: UNAVAILABLE
    decide_within: WITHIN
    signals: {seven: msg.data % 7 == 0}
properties:
  - id: no_sevens
    formula: 'not {topic: "/number", seven}'
    guards: [/number]
"""
GATE_AND_LOG = GATE.replace("properties:", "  - {topic: /logged, type: std_msgs/Int64}\nproperties:")
SWITCH = """
id: switch
description: A switch that is only put on, and then says so
streams:
  - service: /switch
    type: std_srvs/SetBool
    action: filter
    decide_within: 60s
    denied_response: {success: false, message: not now}
    request: {signals: {on: msg.data}}
    response: {signals: {text: msg.message}}
properties:
  - id: only_on
    formula: '{service: "/switch", kind: request} -> {on}'
    guards: [/switch]
  - id: no_nonsense
    formula: 'not {service: "/switch", kind: response, text: "nonsense"}'
    guards: [/switch]
"""
SILENCE = "  - {topic: /silent, type: geometry_msgs/PointStamped, latency: 100s}\nproperties:"
HELD = (
    GATE.replace("50ms", "30s")
    .replace("INTERCEPT", "publisher")
    .replace("UNAVAILABLE", "deny")
    .replace("WITHIN", "60s")
    .replace("properties:", SILENCE)
)
"""Numbers wait for a topic that nobody speaks on, longer than any test does."""
ENDLESS = SWITCH.replace("streams:", "ordering: {max_delay: 30s}\nstreams:").replace("properties:", SILENCE)
"""So do calls."""
SIDES = {"publisher": ("/number_mon", "/number"), "subscriber": ("/number", "/number_mon")}
"""Where messages come from and where they go, by `intercept`."""

FAST = int(os.environ.get("MESSAGES", "5000"))
"""How many messages are sent at 1 kHz."""


def spec_folder(folder: Path, text: str, **words: str) -> Path:
    """A folder with a spec; each of the words stands in it in capitals for its value."""
    for word, value in words.items():
        text = text.replace(word.upper(), value)
    specs = folder / "specs"
    specs.mkdir()
    (specs / "spec.yaml").write_text(text)
    return specs


def settled(server: Server, count: int) -> list[Data]:
    """The events of session `s`, once there are so many and it is known of each what was done with it."""
    return eventually(
        lambda: server.events("s"), lambda found: len(found) >= count and all(e["passed"] is not None for e in found)
    )
