"""The channels of a session, and what is written to them: a channel a stream, a channel a property, and a log."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from oracle_server.core.events import Order
from oracle_server.core.kinds import KINDS, TICK
from oracle_server.core.records import VerdictRecord
from oracle_server.foxglove.schemas import LOG, VERDICT, Schema, Signals

Line = Mapping[str, Any]
"""A line of a session's trace, as plain data."""
_OWN = "/oracle"
"""Under it are the channels of properties: `PROPERTY`, and in the order of arrival `PROPERTY/arrival`."""
LOG_TOPIC = f"{_OWN}/log/episodes"
"""No property has a channel of this name, whatever it is called."""
_TICKS = f"{_OWN}/deadlines/ticks"
VALUES = {"true": 1, "currently_true": 1, "unknown": 0, "currently_false": -1, "false": -1}
"""What is plotted, by the outcome."""


class Channel(NamedTuple):
    """A channel, and what is known of it beside its messages."""

    topic: str
    schema: Schema
    metadata: Mapping[str, str]


class Message(NamedTuple):
    """A message in its channel; `time` is when the server had it, and `published` when its event was published (ns).

    `seq` is the number of the message in the channel, 0 where it has none.
    """

    channel: Channel
    time: int
    published: int
    seq: int
    data: Mapping[str, Any]


class Streams:
    """The messages of streams: the lines of a trace, whose signals are learnt before."""

    def __init__(self, prefix: str = "") -> None:
        """Begin with no stream known; `prefix` goes before the channels' names."""
        self._prefix = prefix
        self._known: dict[tuple[str, str], tuple[str, Signals]] = {}

    def learn(self, stream: str, kind: str, signals: Mapping[str, object]) -> None:
        """Take the signals of an event of a stream."""
        self._of(stream, kind)[1].learn(signals)

    def message(self, line: Line) -> Message:
        """A line as a message; what it does not have is left out, as a schema has one type for each field."""
        topic, signals = self._of(line["stream"], line["kind"])
        data = {name: value for name, value in line.items() if value is not None}
        channel = Channel(topic, signals.schema, {"kind": line["kind"]})
        return Message(channel, line["arrived"], line["stamp"], line["seq"], data)

    def _of(self, stream: str, kind: str) -> tuple[str, Signals]:
        known = self._known.get((stream, kind))
        if known is None:
            topic = self._prefix + _stream_topic(stream, kind)
            known = self._known[stream, kind] = topic, Signals(f"{topic} ({kind})")
        return known


def _stream_topic(stream: str, kind: str) -> str:
    if kind == TICK:
        return _TICKS
    traits = KINDS.get(kind)
    return stream if traits and traits.sole else f"{stream}/{kind}"


def property_channel(name: str, order: Order, prefix: str = "") -> Channel:
    """The channel of a property in an order."""
    topic = f"{prefix}{_OWN}/{name}" + ("/arrival" if order == "arrival" else "")
    return Channel(topic, VERDICT, {"property": name, "order": order})


def verdict_message(record: VerdictRecord, prefix: str = "") -> Message:
    """A verdict's record, which is no revision, as a message of its property."""
    outcome, explanation, robustness = str(record["outcome"]), record["explanation"], record["robustness"]
    data = {
        "outcome": outcome,
        "value": VALUES[outcome],
        "robustness": None if isinstance(robustness, str) else robustness,
        "violation": record["violation"],
        "degraded": record["degraded"],
        "explanation": None if explanation is None else explanation["text"],
        **{key: record[key] for key in ("n", "step", "stream", "kind", "monitor", "seq")},
    }
    there = {key: value for key, value in data.items() if value is not None}
    channel = property_channel(record["property"], record["order"], prefix)
    return Message(channel, record["judged"], record["stamp"], record["n"], there)


def log_channel(prefix: str = "") -> Channel:
    """The channel of the log."""
    return Channel(prefix + LOG_TOPIC, LOG, {})


def log_message(level: int, name: str, text: str, time: int, stamp: int, prefix: str = "") -> Message:
    """A line of the log, as `foxglove.Log` has it."""
    sec, nsec = divmod(stamp, 10**9)
    timestamp = {"sec": sec, "nsec": nsec}
    data = {"timestamp": timestamp, "level": level, "message": text, "name": name, "file": "", "line": 0}
    return Message(log_channel(prefix), time, stamp, 0, data)
