"""Reads the replies of external oracles: a verdict, and possibly the event that it is about."""

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
"""Never final: some oracles send `true` and `false` as final verdicts, others as verdicts of one event."""
_KEYS = ("verdict", "ok")
_LONGEST = 100
"""Characters of a reply that are shown."""
_SAME_TIME = 1e-3
"""Seconds by which the time in a reply may differ from that of its event."""


class OtherEventError(OracleError):
    """A reply about another event than the one that was sent."""


def read_reply(text: str | bytes, event: Mapping[str, Any]) -> Answer:
    """Read the reply to an event; one that can't be read gives an unknown outcome. Raises `OtherEventError`."""
    value = _value(text)
    if not isinstance(value, Mapping):
        return _answer([value])
    echoed = not value.keys().isdisjoint(GROUPS)
    if echoed and not _is_about(event, value):
        raise OtherEventError
    verdicts = [value[key] for key in _KEYS if key in value and not (echoed and key in event)]
    return _answer(verdicts or [value])


def _value(text: str | bytes) -> Any:
    """The JSON value of a reply, or its text where it is not JSON; NaN and infinities are read as their names."""
    try:
        return json.loads(text, parse_constant=str)
    except (ValueError, RecursionError):
        return text if isinstance(text, str) else text.decode(errors="replace")


def _answer(verdicts: list[Any]) -> Answer:
    outcomes = {_outcome(verdict) for verdict in verdicts}
    shown = " and ".join(_shown(verdict) for verdict in verdicts)
    if len(outcomes) == 1 and None not in outcomes:
        (outcome,) = outcomes
        assert outcome is not None  # noqa: S101 -- the line above
        return Answer(outcome, f"answered {shown}")
    return Answer(Outcome.UNKNOWN, f"answered {shown}, which is no verdict")


def _outcome(verdict: Any) -> Outcome | None:
    if isinstance(verdict, bool):
        return _WORDS["true" if verdict else "false"]
    return _WORDS.get(verdict.strip().lower()) if isinstance(verdict, str) else None


def _shown(verdict: Any) -> str:
    text = json.dumps(verdict, ensure_ascii=False)
    return text if len(text) <= _LONGEST else text[:_LONGEST] + "…"


def _is_about(event: Mapping[str, Any], reply: Mapping[str, Any]) -> bool:
    """Whether a reply that repeats its event repeats this one; oracles may round the time."""
    name = next(key for key in GROUPS if key in event)
    if str(reply.get(name)).removeprefix("/") != event[name].removeprefix("/"):
        return False
    sent = event["time"]
    time = reply.get("time", sent)  # compared alone: an integer too large for a float can't be subtracted
    return not isinstance(time, int | float) or sent - _SAME_TIME < time < sent + _SAME_TIME
