"""What an oracle that speaks ROSMonitoring's protocol replies: a word about the event that it was sent."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from oracle_server.core.engine import Answer
from oracle_server.core.errors import OracleError
from oracle_server.core.kinds import GROUPS
from oracle_server.core.verdicts import Outcome

_WORDS = {
    "true": Outcome.CURRENTLY_TRUE,
    "currently_true": Outcome.CURRENTLY_TRUE,
    "false": Outcome.CURRENTLY_FALSE,
    "currently_false": Outcome.CURRENTLY_FALSE,
    "violated": Outcome.CURRENTLY_FALSE,
    "violation": Outcome.CURRENTLY_FALSE,
    "unknown": Outcome.UNKNOWN,
}
"""Never final: for some oracles `true` and `false` are, others say them of one event."""
_KEYS = ("verdict", "ok")
_LONGEST = 100
_SAME_TIME = 1e-3


class OtherEventError(OracleError):
    """A reply that is about another event than was asked about."""


def read_reply(text: str | bytes, event: Mapping[str, Any]) -> Answer:
    """What a reply says of an event. Raises `OtherEventError`; what can't be understood is unknown."""
    value = _value(text)
    if not isinstance(value, Mapping):
        return _answer([value])
    echoed = not value.keys().isdisjoint(GROUPS)
    if echoed and not _is_about(event, value):
        raise OtherEventError
    said = [value[key] for key in _KEYS if key in value and not (echoed and key in event)]
    return _answer(said or [value])


def _value(text: str | bytes) -> Any:
    """The JSON value of a reply, or its text where it is no JSON; numbers that JSON lacks are read as their names."""
    try:
        return json.loads(text, parse_constant=str)
    except (ValueError, RecursionError):
        return text if isinstance(text, str) else text.decode(errors="replace")


def _answer(said: list[Any]) -> Answer:
    outcomes = {_outcome(word) for word in said}
    shown = " and ".join(_shown(word) for word in said)
    if len(outcomes) == 1 and None not in outcomes:
        (outcome,) = outcomes
        assert outcome is not None  # noqa: S101 -- the line above
        return Answer(outcome, f"said {shown}")
    return Answer(Outcome.UNKNOWN, f"said {shown}, which is no verdict")


def _outcome(word: Any) -> Outcome | None:
    if isinstance(word, bool):
        return _WORDS["true" if word else "false"]
    return _WORDS.get(word.strip().lower()) if isinstance(word, str) else None


def _shown(word: Any) -> str:
    text = json.dumps(word, ensure_ascii=False)
    return text if len(text) <= _LONGEST else text[:_LONGEST] + "…"


def _is_about(event: Mapping[str, Any], reply: Mapping[str, Any]) -> bool:
    """Whether a reply that repeats the event that it is about repeats this one; oracles may round its time."""
    name = next(key for key in GROUPS if key in event)
    if str(reply.get(name)).removeprefix("/") != event[name].removeprefix("/"):
        return False
    time = reply.get("time", event["time"])
    return not isinstance(time, int | float) or abs(time - event["time"]) < _SAME_TIME
