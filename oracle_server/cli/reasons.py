"""An explained verdict as text: the tree of its reasons, each with the event that decides it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from oracle_server.core.errors import one_line
from oracle_server.core.kinds import GROUPS, TICK

_NAMED = frozenset({*GROUPS, "kind", "monitor"})
"""Signals that are part of an event's description, and not listed with the others."""


def explanation_text(record: Mapping[str, Any]) -> str:
    """The text of a verdict record with its explanation, line by line."""
    why = record["explanation"]
    if why is None:
        return f"verdict {record['n']}: {record['property']} is {record['outcome']}; there is no explanation\n"
    head = f"verdict {record['n']}: {record['property']} is {record['outcome']}, decided by {_event(why['event'])}"
    lines = [head, f"  {why['formula']}"]
    values = why.get("values")
    if values:
        given = ", ".join(f"{k} = {'any other value' if v is None else json.dumps(v)}" for k, v in values.items())
        others = why.get("other_values")
        lines.append(f"  for {given}" + (f" (and {others} more)" if others else ""))
    lines += _lines(why.get("reasons", ()), "    ")
    return "".join(f"{one_line(line)}\n" for line in lines)


def _lines(reasons: Sequence[Mapping[str, Any]], indent: str) -> Iterator[str]:
    for reason in reasons:
        yield f"{indent}{reason['formula']}: {reason['text']}"
        if reason.get("event"):
            yield f"{indent}    by {_event(reason['event'])}"
        yield from _lines(reason.get("reasons", ()), indent + "  ")


def _event(event: Mapping[str, Any]) -> str:
    if event["kind"] == TICK:
        return "an expired deadline"
    where = f"{event['stream']} ({event['kind']} {event['seq']} of {event['monitor']}, stamp {event['stamp']})"
    shown = {name: value for name, value in event["signals"].items() if name not in _NAMED}
    return where + "".join(f" {name}={json.dumps(value)}" for name, value in sorted(shown.items()))
