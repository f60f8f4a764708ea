"""JSON Schemas of the messages: each field has one type, as those who read them for plots know no choice of types."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

Fields = Mapping[str, Any]
NUMBER, INTEGER, TEXT, BOOLEAN = ({"type": name} for name in ("number", "integer", "string", "boolean"))
_TEXTS = {"type": "array", "items": TEXT}


class Schema(NamedTuple):
    """A JSON Schema by the name under which tools keep it: schemas that differ have different names."""

    name: str
    content: Mapping[str, Any]


def _schema(name: str, description: str, fields: Fields) -> Schema:
    content = {"title": name, "description": description, "type": "object", "properties": dict(fields)}
    return Schema(name, content)


def _object(fields: Fields, description: str = "") -> Fields:
    told = {"description": description} if description else {}
    return {"type": "object", **told, "properties": dict(fields)}


def _told(kind: Fields, description: str) -> Fields:
    return {**kind, "description": description}


_PLACE = _object({
    "position": INTEGER, "order": TEXT, "judged": INTEGER, "late": BOOLEAN, "skewed": BOOLEAN, "forced": BOOLEAN,
    "skipped": BOOLEAN, "degraded": BOOLEAN, "released": TEXT, "place": INTEGER, "bypassed": _TEXTS,
})  # fmt: skip
_EVENT = {
    "stream": TEXT, "kind": TEXT, "monitor": TEXT, "seq": INTEGER,
    "stamp": _told(INTEGER, "When it was published, in ns"),
    "arrived": _told(INTEGER, "When it came, in ns"),
    "source": _told(TEXT, "The node that it is from"),
    "call": INTEGER, "goal_id": TEXT, "status": TEXT,
    "lost": _told(INTEGER, "How many events before it were lost"),
    "ask": _told(BOOLEAN, "Whether a decision was asked for"),
    "decision": _told(TEXT, "allow or deny, where one was asked for"),
    "denied_by": {**_TEXTS, "description": "The properties that denied it"},
    "passed": _told(BOOLEAN, "Whether the adapter let it pass"),
    "why": _told(TEXT, "Why it did"),
    "failed": {**_TEXTS, "description": "The signals that could not be computed"},
    "places": {"type": "array", "items": _PLACE},
    "begun": INTEGER,
}  # fmt: skip
VERDICT = _schema(
    "oracle_server.Verdict",
    "How a property stands: at its first step, wherever that changes, at each violation, and at the last step",
    {
        "outcome": _told(TEXT, "true, currently_true, currently_false, false or unknown; true and false are final"),
        "value": _told(NUMBER, "The same to plot: 1 holds, 0 is not known, -1 does not hold"),
        "robustness": _told(NUMBER, "How far it is from turning, where its engine measures that and it is finite"),
        "violation": _told(BOOLEAN, "Whether it became negative here, or something that it awaits did not come"),
        "degraded": _told(BOOLEAN, "Whether something before is known to be lost"),
        "explanation": _told(TEXT, "Why it does not hold, at violations"),
        "n": _told(INTEGER, "The number of the verdict in its session"),
        "step": INTEGER,
        "stream": _told(TEXT, "Of the event at which it stands so, as what follows"),
        "kind": TEXT, "monitor": TEXT, "seq": INTEGER,
    },
)  # fmt: skip
LOG = _schema(
    "foxglove.Log",
    "A log message",
    {
        "timestamp": _object({"sec": INTEGER, "nsec": INTEGER}, "Timestamp of log message"),
        "level": {
            "description": "Log level",
            "oneOf": [
                {"title": title, "const": level}
                for level, title in enumerate(("UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"))
            ],
        },
        "message": TEXT, "name": _told(TEXT, "The property"), "file": TEXT, "line": INTEGER,
    },
)  # fmt: skip


class Signals:
    """Which signals the events of a stream have, and of which type; one of several types is not in the schema."""

    def __init__(self, topic: str) -> None:
        """Begin without signals."""
        self._topic = topic
        self._types: dict[str, Fields | None] = {}
        self._schema: Schema | None = None
        self._versions = 0

    def learn(self, signals: Mapping[str, object]) -> None:
        """Take the signals of an event."""
        for name, value in signals.items():
            kind = BOOLEAN if isinstance(value, bool) else TEXT if isinstance(value, str) else NUMBER
            if name not in self._types:
                self._types[name], self._schema = kind, None
            elif self._types[name] not in (kind, None):
                self._types[name], self._schema = None, None

    @property
    def schema(self) -> Schema:
        """The schema of the events by what is known so far: the same object until more is."""
        if self._schema is None:
            self._versions += 1
            name = f"oracle_server.Event:{self._topic}" + (f"#{self._versions}" if self._versions > 1 else "")
            signals = {name: kind for name, kind in sorted(self._types.items()) if kind is not None}
            fields = {**_EVENT, "signals": _object(signals, "What formulas saw of the message")}
            self._schema = _schema(name, "An event, what formulas saw of it, and how it was judged", fields)
        return self._schema
