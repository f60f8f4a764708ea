"""What schemas say of signals, and where the lines of episodes are."""

from __future__ import annotations

from typing import Any

import pytest

from oracle_server.core.episode import EpisodeRecord
from oracle_server.core.records import VerdictRecord
from oracle_server.foxglove.channels import VALUES, Streams, verdict_message
from oracle_server.foxglove.episodes import Recorded, told_message
from oracle_server.foxglove.schemas import LOG, VERDICT, Signals
from oracle_server.sessions.beginnings import Told
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


def episode(first: int, began: float, until: float | None, **more: Any) -> EpisodeRecord:
    made: Any = {
        "session": "s", "spec": "spec", "property": "p", "order": "publication", "first": first, "last": first,
        "began": round(began * S), "until": None if until is None else round(until * S), "open": until is None,
        "final": False, "count": 2, "worst": None, "explanation": None, **more,
    }  # fmt: skip
    return made  # type: ignore[no-any-return]


def test_what_becomes_of_an_episode_is_a_line_unless_it_is_known_by_another_beginning() -> None:
    lasted, final = episode(1, 1, 3.5), episode(1, 1, None, final=True, explanation="p is late", order="arrival")
    lines = [
        told_message(told, 9 * S)
        for told in (Told("begun", False, final), Told("ended", False, lasted), Told("retracted", False, lasted))
    ]
    assert [(m.data["level"], m.data["name"], m.data["message"], m.published) for m in lines if m] == [
        (4, "p (arrival)", "p is late", S),
        (2, "p", "p: ended at 3.500 s; 2 violations in 2.500 s", round(3.5 * S)),
        (2, "p", "retracted: p was not violated at 1.000 s: what came late shows it", S),
    ]
    assert told_message(Told("begun", True, lasted), 9 * S) is None


def test_an_episode_is_told_with_its_first_verdict_and_once_it_is_over() -> None:
    recorded = Recorded([episode(4, 8, None), episode(1, 1, 2), episode(3, 5, 6)])
    found = recorded.take(record(1, "currently_false", n=1))
    assert recorded.passed(round(2.5 * S), 3 * S) == []
    found += recorded.passed(3 * S, 3 * S)
    found += recorded.take(record(8, "currently_false", n=4))  # the first of one is not kept any more
    assert [(m.data["level"], m.published / S, m.time / S) for m in found] == [
        (3, 1, 1),
        (2, 2, 3),
        (3, 5, 8),
        (3, 8, 8),
    ]
    assert [m.published / S for m in recorded.rest(9 * S)] == [6]
    assert recorded.rest(9 * S) == []
