"""Robustness through a session: held signals, guards, latches, explanations and records."""

from __future__ import annotations

import json
from typing import Any

import pytest

from oracle_server.core.errors import SpecError
from oracle_server.core.events import Event, StreamKey
from oracle_server.core.plan import plan
from oracle_server.core.records import VerdictRecord
from oracle_server.core.session import Session
from oracle_server.core.verdicts import record
from oracle_server.engines import stl
from oracle_server.engines.table import make_engines
from oracle_server.specfiles.load import parse_spec

SPEC = """
id: cart
ordering: {{by: arrival}}
streams:
  - topic: /odom
    signals: {{speed: msg.v}}
    hold: [{hold}]
  - topic: /cmd
    action: filter
    signals: {{wanted: msg.v}}
properties:
  - id: slow
    formula: historically[0:2](speed < 3)
    engine: rtamt
    guards: [/cmd]
    latch: {latch}
  - {{id: seen, formula: 'once {{topic: "/odom"}}'}}
"""


@pytest.mark.parametrize(
    ("formula", "column", "told"),
    [
        ("mode == 2 -> speed < 3", 19, "write two inequalities with a margin, as in `mode > 1.5 and mode < 2.5`"),
        ("once(mode !== 2)", 24, "write two inequalities with a margin, as in `mode < 1.5 or mode > 2.5`"),
        ("(mode > 1.5 and mode <= 2.5) -> speed >= 3", None, ""),
    ],
)
def test_an_equality_that_can_be_decided_on_one_side_alone_is_warned_of(
    formula: str, column: int | None, told: str
) -> None:
    found = parse_spec(
        "id: x\nstreams:\n  - {topic: /a, signals: {mode: msg.m, speed: msg.v}, hold: [mode, speed]}\n"
        f"properties:\n  - id: p\n    formula: {formula}\n    engine: rtamt\n",
        "x",
    )
    assert [(w.line, w.column) for w in found.warnings] == ([] if column is None else [(6, column)])
    assert all(told in w.message for w in found.warnings)


@pytest.mark.parametrize(("condition", "outcomes"), [
    ("mode == 2", ["unknown", "currently_true"]),
    ("(mode > 1.5 and mode < 2.5)", ["currently_false", "currently_true"]),
])  # fmt: skip
def test_what_is_asked_in_a_mode_is_violated_in_it_with_a_margin_alone(condition: str, outcomes: list[str]) -> None:
    ready = plan(
        parse_spec(
            "id: x\nordering: {by: arrival}\nstreams: [{topic: /odom, signals: {mode: msg.m, speed: msg.v}}]\n"
            f"properties: [{{id: p, engine: rtamt, formula: '{condition} -> speed < 3'}}]\n",
            "x",
        ).spec
    )
    session = Session(ready, make_engines(ready))
    found = [
        verdict.outcome.value
        for seq, mode in enumerate((2, 1), start=1)
        for j in session.ingest(Event(StreamKey("/odom", "topic"), "m", seq, None, seq, {"m": mode, "v": 5}))
        for verdict in j.verdicts
    ]
    assert found == outcomes


def judge(*events: tuple[str, Any], hold: str = "speed", latch: str = "false") -> list[VerdictRecord]:
    """The records of `slow`; every event asks."""
    ready = plan(parse_spec(SPEC.format(hold=hold, latch=latch), "cart").spec)
    session = Session(ready, make_engines(ready))
    records = []
    for seq, (topic, v) in enumerate(events, start=1):
        event = Event(StreamKey(topic, "topic"), "m", seq, None, seq, {"v": v}, ask=True)
        for judged in session.ingest(event):
            slow, seen = (record(judged, verdict) for verdict in judged.verdicts)
            assert seen["robustness"] is None
            records.append(slow)
    return records


def told(records: list[VerdictRecord]) -> list[tuple[str | None, Any]]:
    return [(r["outcome"], r["robustness"]) for r in records]


def test_a_held_signal_is_a_sample_at_every_event_once_it_is_known() -> None:
    records = judge(("/cmd", 0), ("/odom", 1.5), ("/cmd", 0), ("/odom", 3.25), ("/cmd", 0), ("/odom", 1))
    assert told(records) == [
        ("unknown", None),
        ("currently_true", 1.5),
        ("currently_true", 1.5),
        ("currently_false", -0.25),
        ("currently_false", -0.25),
        ("currently_false", -0.25),
    ]
    assert [r["decision"] for r in records if r["stream"] == "/cmd"] == ["deny", "allow", "deny"]


def test_without_hold_other_events_are_unknown_and_denied() -> None:
    records = judge(("/odom", 1.5), ("/cmd", 0), ("/odom", 2), hold="")
    assert told(records) == [("currently_true", 1.5), ("unknown", None), ("currently_true", 1)]
    assert records[1]["decision"] == "deny"


def test_a_failed_signal_is_unknown_until_the_next_value() -> None:
    records = judge(("/odom", 1), ("/odom", "NaN"), ("/cmd", 0), ("/odom", 2))
    assert told(records) == [("currently_true", 2), ("unknown", None), ("unknown", None), ("currently_true", 1)]


@pytest.mark.parametrize(
    ("first", "is_degraded"),
    [
        ([("/cmd", 0), ("/cmd", 1)], False),
        ([("/odom", "NaN")], True),
        ([("/odom", "fast"), ("/cmd", 0)], True),
        ([("/cmd", 0), ("/odom", None), ("/cmd", 0)], False),
    ],
)
def test_nothing_is_missed_before_all_signals_have_been_there(
    first: list[tuple[str, Any]], *, is_degraded: bool
) -> None:
    records = judge(*first, ("/odom", 1.5))
    assert told(records) == [*[("unknown", None)] * len(first), ("currently_true", 1.5)]
    assert records[-1]["degraded"] is is_degraded


def test_a_gap_later_on_is_a_step_that_was_not_judged() -> None:
    records = judge(("/cmd", 0), ("/odom", 1), ("/cmd", 0), ("/odom", 1), hold="")
    assert [record["degraded"] for record in records] == [False, False, False, True]


def test_a_violation_tells_the_robustness_and_the_signals() -> None:
    (_, violated) = judge(("/odom", 1), ("/odom", 4))
    explanation = violated["explanation"]
    assert explanation is not None
    assert explanation["text"].endswith("for speed = 4.0: historically[0:2](speed < 3): robustness -1")
    assert explanation["values"] == {"speed": 4.0}
    json.dumps(violated, allow_nan=False)


def test_a_latched_property_is_measured_up_to_its_violation() -> None:
    assert told(judge(("/odom", 4), ("/odom", 1), latch="true")) == [("false", -1), ("false", None)]


def test_infinities_are_the_wires_texts() -> None:
    text = SPEC.format(hold="speed", latch="false").replace("[0:2]", "[2:3]")
    ready = plan(parse_spec(text, "cart").spec)
    (judged,) = Session(ready, make_engines(ready)).ingest(
        Event(StreamKey("/odom", "topic"), "m", 1, None, 1, {"v": 9})
    )
    assert json.loads(json.dumps(record(judged, judged.verdicts[0]), allow_nan=False))["robustness"] == "Infinity"


def test_check_warns_where_a_signal_is_missing() -> None:
    warnings = parse_spec(SPEC.format(hold="", latch="false"), "cart").warnings
    assert any("unknown where a signal is missing: /cmd (speed)" in w.message for w in warnings)
    assert not any(
        "missing" in w.message for w in parse_spec(SPEC.format(hold="speed", latch="false"), "cart").warnings
    )


def test_where_rtamt_is_not_installed_the_spec_is_refused_and_says_how_to_mend_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(stl, "find_spec", lambda _: None)
    with pytest.raises(SpecError) as refused:
        parse_spec(SPEC.format(hold="speed", latch="false"), "cart")
    (finding,) = refused.value.findings
    assert (finding.line, "oracle-server[rtamt]" in finding.message or "3.12" in finding.message) == (14, True)
