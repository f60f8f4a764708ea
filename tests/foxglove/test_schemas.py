"""What schemas say of signals, and when episodes begin and end."""

from __future__ import annotations

from typing import Any

import pytest

from oracle_server.core.records import VerdictRecord
from oracle_server.foxglove.channels import VALUES, Streams, verdict_message
from oracle_server.foxglove.episodes import Episodes
from oracle_server.foxglove.schemas import LOG, VERDICT, Signals
from tests.foxglove.reading import fields

S = 10**9


def test_the_schemas_are_such_as_tools_take() -> None:
    assert fields(dict(VERDICT.content))[".value"] == "number"
    assert fields(dict(LOG.content))[".timestamp.sec"] == "integer"


def test_a_signal_of_several_types_is_not_in_the_schema_and_one_that_comes_later_is() -> None:
    signals = Signals("/scan")
    signals.learn({"ahead": 1, "text": "a", "on": True, "mixed": 1})
    first = signals.schema
    signals.learn({"ahead": 2.5, "mixed": 2})
    assert signals.schema is first
    signals.learn({"mixed": "a", "late": 0.5})
    signals.learn({"mixed": 3})
    second = signals.schema
    assert second.name != first.name
    assert {k: v for k, v in fields(dict(second.content)).items() if k.startswith(".signals")} == {
        ".signals.ahead": "number", ".signals.late": "number", ".signals.on": "boolean", ".signals.text": "string",
    }  # fmt: skip


@pytest.mark.parametrize("kind", ["topic", "request", "goal", "tick"])
def test_no_two_streams_have_a_channel_in_common(kind: str) -> None:
    streams, others = Streams("/s"), ["topic", "request", "goal", "tick"]
    line = {"stream": "/a", "arrived": 2, "stamp": 1, "seq": 3, "call": None}
    made = {other: streams.message({**line, "kind": other}) for other in others}
    same = [other for other in others if made[other].channel.schema.name == made[kind].channel.schema.name]
    assert same == [kind]
    assert made[kind].channel.topic.startswith("/s/")
    assert "call" not in made[kind].data


def record(at: float, outcome: str, *, violation: bool = False, **more: Any) -> VerdictRecord:
    why = {"text": "p does not hold", "formula": "", "event": {}} if violation else None
    made: Any = {
        "n": 1, "step": None, "property": "p", "order": "publication", "outcome": outcome, "stream": "/a",
        "kind": "topic", "monitor": "m", "seq": 1, "stamp": round(at * S), "judged": round(at * S),
        "violation": violation, "degraded": False, "robustness": None, "explanation": why, **more,
    }  # fmt: skip
    return made  # type: ignore[no-any-return]


def test_a_record_becomes_what_can_be_plotted() -> None:
    assert {outcome: verdict_message(record(1, outcome)).data["value"] for outcome in VALUES} == VALUES
    assert "robustness" not in verdict_message(record(1, "true", robustness="Infinity")).data
    assert verdict_message(record(1, "true", robustness=0.5)).data["robustness"] == 0.5
    assert verdict_message(record(1, "true", order="arrival")).channel.topic == "/oracle/p/arrival"


def levels(episodes: Episodes, *told: VerdictRecord) -> list[tuple[int, float]]:
    found = [message for one in told for message in episodes.take(one)]
    return [(m.data["level"], m.published / S) for m in found]


def test_an_episode_goes_on_while_its_property_does_not_hold() -> None:
    episodes, no, yes = Episodes(), "currently_false", "currently_true"
    assert levels(episodes, record(1, no, violation=True)) == [(3, 1)]
    assert episodes.passed(9 * S, 9 * S) == []
    assert levels(episodes, record(10, yes), record(10.5, no, violation=True), record(11, yes), record(12, yes)) == []
    assert [m.data["message"] for m in episodes.passed(12 * S + 1, 13 * S)] == [
        "p: ended at 11.000 s; 2 violations in 10.000 s"
    ]
    assert levels(episodes, record(14, "false", violation=True), record(30, "false")) == [(4, 14)]


def test_what_was_awaited_and_did_not_come_is_an_episode_too() -> None:
    episodes, yes = Episodes(), "currently_true"
    told = [record(at, yes, violation=True) for at in (1, 1.5, 3)]
    assert levels(episodes, *told) == [(3, 1), (2, 1.5), (3, 3)]


def test_the_two_orders_have_episodes_of_their_own() -> None:
    episodes = Episodes()
    both = [record(1, "false", violation=True, order=order) for order in ("publication", "arrival")]
    assert [m.data["name"] for one in both for m in episodes.take(one)] == ["p", "p (arrival)"]
