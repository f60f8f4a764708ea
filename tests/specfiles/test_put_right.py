"""What `check` says of properties that ask whether the times go back by which messages are put in order."""

from __future__ import annotations

from pathlib import Path

import pytest

from oracle_server.replay.opening import open_recording
from oracle_server.replay.run import Replay
from oracle_server.specfiles.load import parse_spec

SPEC = """\
id: stamps
ordering: {by: BY}
streams:
  - topic: /odom
    signals:
      t: msg.header.stamp.sec + msg.header.stamp.nanosec / 1e9
      ns: msg.header.stamp.nanosec
      n: msg.n
  - {topic: /imu, ordered: ORDERED}
  - {topic: /fmu, signals: {us: msg.timestamp}, stamp: {field: timestamp, unit: us, epoch: boot}, ordered: ORDERED}
derive:
  dt: {delta: t}
  dns: {delta: ns}
  dn: {delta: n}
  last_us: {previous: us}
properties:
  - {id: p, formula: 'FORMULA'}
"""
RECORDED = """\
{"topic": "/imu", "time": 0.95, "header": {"stamp": {"sec": 0, "nanosec": 950000000}}}
{"topic": "/odom", "time": 1.0, "header": {"stamp": {"sec": 1, "nanosec": 0}}}
{"topic": "/odom", "time": 1.1, "header": {"stamp": {"sec": 1, "nanosec": 200000000}}}
{"topic": "/odom", "time": 1.15, "header": {"stamp": {"sec": 1, "nanosec": 100000000}}}
{"topic": "/imu", "time": 1.3, "header": {"stamp": {"sec": 1, "nanosec": 300000000}}}
"""


def written(formula: str, by: str = "publication", ordered: str = "true") -> str:
    return SPEC.replace("FORMULA", formula).replace("BY", by).replace("ORDERED", ordered)


def told(formula: str, by: str = "publication", ordered: str = "true") -> list[str]:
    warnings = parse_spec(written(formula, by, ordered), "s.yaml").warnings
    return [each.message for each in warnings if "goes back" in each.message]


@pytest.mark.parametrize(
    ("formula", "asks"),
    [
        ("not {dt < 0}", "`dt < 0` asks whether `t` goes back, by which messages of /odom"),
        ("{dt: *} -> {dt > 0}", "`dt > 0` asks whether `t` goes back"),
        ("not {us < last_us}", "`us < last_us` asks whether `us` goes back, by which messages of /fmu"),
        ("forall[x, y]. {t: *x} and pre once {t: *y} -> *x >= *y", "`*x >= *y` asks whether `t` goes back"),
    ],
)
def test_times_of_the_order_that_are_asked_to_go_on_are_told_of(formula: str, asks: str) -> None:
    (found,) = told(formula)
    assert asks in found
    assert found.endswith(
        "within `max_delay`, 200ms, is not found; write `ordering: {by: arrival}`, in a spec of its own"
    )
    assert told(formula, by="arrival") == []


@pytest.mark.parametrize("formula", ["not {dt > 0.5}", "not {dns < 0}", "not {dn < 0}", "not {dt < -0.1}"])
def test_what_the_order_does_not_put_right_is_not(formula: str) -> None:
    assert told(formula) == []


def test_one_stream_in_order_waits_for_no_other() -> None:
    assert told("not {dt < 0}", ordered="false") == []


@pytest.mark.parametrize(("by", "violations"), [("publication", 0), ("arrival", 1)])
def test_the_mend_has_it_found(tmp_path: Path, by: str, violations: int) -> None:
    spec = parse_spec(written("not {dt < 0}", by), "s.yaml").spec
    recording = tmp_path / "r.jsonl"
    recording.write_text(RECORDED)
    replay = Replay(spec, open_recording(recording, spec))
    list(replay)
    assert replay.states()["p"]["violations"] == violations
