"""An explained verdict as text: the tree of its reasons, each with the event that decides it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from oracle_server.core.errors import one_line
from oracle_server.core.events import StreamKey
from oracle_server.core.kinds import GROUPS, TICK
from oracle_server.core.naming import event_name, moment, step_name

_ENDS = {
    "frontier": "and went on once nothing older could come from there",
    "clock": "and went on once nothing older could come from there",
    "max_delay": "in vain: max_delay was over",
    "capacity": "in vain: there was no room to wait on",
}
_NAMED = frozenset({*GROUPS, "kind", "monitor"})
"""Signals that are part of an event's description, and not listed with the others."""


def explanation_text(record: Mapping[str, Any], *, simulated: bool = False) -> str:
    """The text of a verdict record with its explanation, line by line; `simulated`: as is the session's time."""
    why = record["explanation"]
    if why is None:
        return f"{record['property']} is {record['outcome']}; there is no explanation (#{record['n']})\n"
    where = step_name(record["step"], record["stamp"])
    decided = _event(why["event"])
    head = f"{record['property']} is {record['outcome']} at {where}, decided by {decided} (#{record['n']})"
    lines = [head, f"  {why['formula']}"]
    values = why.get("values")
    if values:
        given = ", ".join(f"{k} = {'any other value' if v is None else json.dumps(v)}" for k, v in values.items())
        others = why.get("other_values")
        lines.append(f"  for {given}" + (f" (and {others} more)" if others else ""))
    lines += _lines(why.get("reasons", ()), "    ")
    if record.get("waited"):
        lines.append(f"  {_waited(record, simulated=simulated)}")
    return "".join(f"{one_line(line)}\n" for line in lines)


def _waited(record: Mapping[str, Any], *, simulated: bool) -> str:
    """How long the event of a record was held, for which streams of which monitors, and what ended that."""
    names = ", ".join(f"{StreamKey(w['stream'], w['kind'])} of {w['monitor']}" for w in record["waited"])
    held = max(0, record["judged"] - record["arrived"]) / 1e6  # a simulated arrival is on another clock
    how = "held" if simulated else f"held {held:.1f} ms"
    return f"{how}: it waited for {names}, {_ENDS[record['released']]}"


def _lines(reasons: Sequence[Mapping[str, Any]], indent: str) -> Iterator[str]:
    for reason in reasons:
        yield f"{indent}{reason['formula']}: {reason['text']}"
        if reason.get("event"):
            yield f"{indent}    by {_event(reason['event'])}"
        yield from _lines(reason.get("reasons", ()), indent + "  ")


def _event(event: Mapping[str, Any]) -> str:
    if event["kind"] == TICK:
        return f"a deadline that ran out at {moment(event['stamp'])}"
    step = f"{step_name(event['step'], event['stamp'])}, " if "step" in event else ""
    where = step + event_name(event["stream"], event["kind"], event["seq"], event["monitor"], event.get("row"))
    shown = {name: value for name, value in event["signals"].items() if name not in _NAMED}
    return where + "".join(f" {name}={json.dumps(value)}" for name, value in sorted(shown.items()))
