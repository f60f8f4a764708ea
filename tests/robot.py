"""Specs that the tests on ROS judge by, and what is asked about their histories."""

from __future__ import annotations

import os
import shutil
import signal
from pathlib import Path

from tests.processes import Data, Server, eventually, without_gaps

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
DIAGNOSED = (
    GATE.replace("/number", "/diagnostics")
    .replace("std_msgs/Int64", "diagnostic_msgs/DiagnosticArray")
    .replace("msg.data % 7 == 0", "msg.header.frame_id == 'uav'")
)
"""What adapters say themselves is filtered."""
GATE_AND_LOG = GATE.replace("properties:", "  - {topic: /logged, type: std_msgs/Int64}\nproperties:")
JOINTS = """
id: joints
description: Each joint has its limit, by whatever message it comes
ordering: {max_delay: 50ms}
streams:
  - topic: /joint_states
    type: sensor_msgs/JointState
    each: msg.name
    signals: {joint: item, position: 'msg.position[index]'}
properties:
  - {id: elbow_in_range, formula: '{joint: elbow} -> {position <= 2.6}'}
"""
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


def by_joint(server: Server) -> None:
    """The elbow is beyond its limit in the second of two messages alone, where it is the first joint."""
    records = eventually(lambda: server.records("s"), lambda found: len(found) == 4)
    assert [(r["row"], r["violation"]) for r in records] == [(0, False), (1, False), (0, True), (1, False)]
    assert len({r["seq"] for r in records}) == 2


def spec_folder(folder: Path, text: str, **words: str) -> Path:
    """A folder with a spec; each of the words stands in it in capitals for its value."""
    for word, value in words.items():
        text = text.replace(word.upper(), value)
    specs = folder / "specs"
    specs.mkdir()
    (specs / "spec.yaml").write_text(text)
    return specs


def changed(folder: Path) -> None:
    """Let a gate's spec say something else, and the session that was judged by it be gone."""
    shutil.rmtree(folder / "data")
    path = folder / "specs" / "spec.yaml"
    text = path.read_text().replace("properties:", "  - {topic: /new, type: std_msgs/Int64}\nproperties:")
    path.write_text(text.replace("intercept: publisher", "intercept: subscriber"))


def leave(server: Server) -> None:
    server.process.end(signal.SIGTERM)


def hang(server: Server) -> None:
    server.process.send(signal.SIGSTOP)


AWAY = [Server.kill, leave, hang]
"""Ways in which an oracle goes away."""


def all_but_sevens(server: Server, count: int) -> None:
    """The history has the numbers up to `count`, multiples of 7 were denied, and nothing was lost."""
    events = settled(server, count)
    assert without_gaps([event["seq"] for event in events])
    verdicts = [("allow", True) if number % 7 else ("deny", False) for number in range(1, count + 1)]
    assert [(event["decision"], event["passed"]) for event in events] == verdicts
    assert server.session("s")["counters"]["lost"] == 0


ALLOWED = [("request", "allow", True), ("response", "allow", True)]


def done(events: list[Data]) -> list[tuple[str, str, bool]]:
    """Of each event its kind, what was decided, and whether it passed."""
    return [(event["kind"], event["decision"], event["passed"]) for event in events]


def settled(server: Server, count: int, **query: str) -> list[Data]:
    """The events of session `s`, once there are so many and it is known of each what was done with it."""
    return eventually(
        lambda: server.events("s", **query),
        lambda found: len(found) >= count and all(e["passed"] is not None for e in found),
    )
