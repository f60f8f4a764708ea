"""What a recording had of each stream and signal: events, and how often a signal was present, absent or failed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NotRequired, TypedDict

from oracle_server.core.events import Projected as OfStep
from oracle_server.core.events import StreamKey
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.plan import Projects, named_signals
from oracle_server.core.ranges import ValueKind
from oracle_server.core.spec import Spec
from oracle_server.core.typed import TypedMessage
from oracle_server.replay.doubts.misfit import misfit, quick
from oracle_server.replay.recording import Projected


class SignalCounts(TypedDict):
    """How many of a stream's events had a signal, lacked it, or failed to give it; `reason` is why the first failed."""

    present: int
    absent: int
    failed: int
    reason: NotRequired[str]


class StreamCounts(TypedDict):
    """The events of a stream, and what they had of its signals.

    `misfits` are messages that can't be of the stream's type, `misfit` is why the first can't.
    """

    events: int
    signals: dict[str, SignalCounts]
    misfits: NotRequired[int]
    misfit: NotRequired[str]


def signal_names(spec: Spec, key: StreamKey) -> tuple[str, ...]:
    """The signals of a stream, in the order of the spec; where it declares none, those that formulas read of it."""
    stream = spec.by_key[key]
    if stream.signals is not None:
        return tuple(stream.signals)
    return tuple(sorted(named_signals(stream, spec.readings, spec.kept)))


def counted_names(spec: Spec, key: StreamKey, type_: TypedMessage | None) -> tuple[str, ...]:
    """The signals whose absence says something: a stream that declares none may be read for what others have.

    Those are the ones that its type lacks; where the type is not known, the ones that another stream declares.
    """
    names = signal_names(spec, key)
    if spec.by_key[key].signals is not None:
        return names
    if type_ is not None:
        return tuple(name for name in names if name in type_.widest.fields)
    elsewhere = frozenset[str]().union(*(stream.signals or () for stream in spec.streams))
    return tuple(name for name in names if name not in elsewhere)


class Counting:
    """Projects the messages of a stream, as recorded or anew, and counts which signals they had."""

    def __init__(self, project: Projects, names: tuple[str, ...], type_: TypedMessage | None = None) -> None:
        """Count the signals of these names, and messages that can't be of the type, where that is known."""
        self.fields = project.fields
        self._project, self._names = project, names
        self._shapes: Counter[tuple[tuple[str, ...], frozenset[str]]] = Counter()
        self._reasons: dict[str, str] = {}
        self._shape = None if type_ is None else type_.widest
        self._quick = bool if self._shape is None else quick(self._shape)
        self._misfits, self._misfit = 0, ""
        self._types: set[tuple[str, type]] = set()

    def __call__(self, message: object) -> OfStep:
        """The signals of a message by name, and the names of those that failed."""
        if isinstance(message, Projected):
            signals, failed = message
        else:
            self._look(message)
            signals, failed = self._project(message)
            if not failed <= self._reasons.keys():
                self._reasons = self._project.reasons(message) | self._reasons
        self._count(signals, failed)
        return signals, failed

    def rows(self, message: object) -> Sequence[OfStep]:
        """The same of each element that is a step of its own, and counts as an event."""
        rows = () if isinstance(message, Projected) else self._project.rows(message)
        if rows:
            self._look(message)
        if any(not failed <= self._reasons.keys() for _, failed in rows):
            self._reasons = self._project.reasons(message) | self._reasons
        for signals, failed in rows:
            self._count(signals, failed)
        return rows

    def _look(self, message: object) -> None:
        why = "" if self._shape is None or self._quick(message) else misfit(self._shape, message)
        if why:
            self._misfits, self._misfit = self._misfits + 1, self._misfit or why

    def _count(self, signals: Mapping[str, Scalar], failed: frozenset[str]) -> None:
        self._shapes[tuple(signals), failed] += 1
        self._types.update([(name, type(value)) for name, value in signals.items()])

    def reasons(self, message: object) -> dict[str, str]:
        """Why each signal of a message failed that did; that is not recorded."""
        return {} if isinstance(message, Projected) else self._project.reasons(message)

    def kinds(self, name: str) -> frozenset[ValueKind]:
        """What kinds of values a signal had."""
        return frozenset(_KINDS[type_] for own, type_ in self._types if own == name)

    def counts(self) -> StreamCounts:
        """What was counted so far."""
        events = self._shapes.total()
        signals: dict[str, SignalCounts] = {}
        for name in self._names:
            present = sum(count for (names, _), count in self._shapes.items() if name in names)
            failed = sum(count for (_, names), count in self._shapes.items() if name in names)
            signals[name] = {"present": present, "absent": events - present - failed, "failed": failed}
            if name in self._reasons:
                signals[name]["reason"] = self._reasons[name]
        counts: StreamCounts = {"events": events, "signals": signals}
        if self._misfits:
            counts |= {"misfits": self._misfits, "misfit": self._misfit}
        return counts


_KINDS: dict[type, ValueKind] = {str: "text", bool: "boolean", int: "number", float: "number"}


def kind_of(value: object) -> ValueKind | None:
    """The kind of a signal's value, None for what stands for any."""
    return _KINDS.get(type(value))


Coverage = dict[StreamKey, StreamCounts]
"""What a recording had of each stream of a spec."""


def silent(coverage: Coverage) -> list[StreamKey]:
    """The streams without events."""
    return [key for key, counts in coverage.items() if not counts["events"]]


def never_there(coverage: Coverage) -> list[tuple[StreamKey, str]]:
    """The signals that no event of their stream had, though it has events."""
    return [
        (key, name)
        for key, counts in coverage.items()
        for name, signal in counts["signals"].items()
        if counts["events"] and not signal["present"]
    ]


def because(signal: SignalCounts) -> str:
    """Why a signal failed first, as the end of a sentence; empty where that is not known."""
    return f": {signal['reason']}" if "reason" in signal else ""
