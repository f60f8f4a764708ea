"""Steps in memory: as any backend keeps them, by arrival, and as rows for questions by time, which read all of them."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter
from typing import Any, TypeVar

import msgspec

from oracle_server.core.events import Order, StreamKey
from oracle_server.core.records import ExplanationRecord
from oracle_server.history.blocks import Block, BlockRow
from oracle_server.history.letters import letters
from oracle_server.history.records import StoredStep

T = TypeVar("T")
_encode = msgspec.json.Encoder().encode


class StepsSource:
    """A session of which the steps are known."""

    begin = end = 0

    def __init__(self, steps: Sequence[StoredStep], decides: Order, *, simulated: bool) -> None:
        self._steps, self.decides, self.simulated = steps, decides, simulated
        self.first, self.last = (steps[0].position, steps[-1].position) if steps else (1, 0)

    def blocks(self, _level: int, _begin: int, _end: int) -> list[Block]:
        """The blocks of a level from one number to before another: none."""
        return []

    def rows(self, first: int, last: int) -> list[BlockRow]:
        """The rows from one position to another."""
        begin = bisect_left(self._steps, first, key=attrgetter("position"))
        end = bisect_left(self._steps, last + 1, key=attrgetter("position"))
        return [_row(step) for step in self._steps[begin:end]]

    def revised(self, after: int) -> int | None:
        """The first position of which rows behind another one say that something else stands."""
        begin = bisect_left(self._steps, after + 1, key=attrgetter("position"))
        revisions = [step.revision for step in self._steps[begin:] if step.revision is not None]
        return min(
            [(c.first - 1) // len(r.changes) + 1 for r in revisions for c in r.changes if c is not None], default=None
        )


def arrival(stored: StoredStep) -> tuple[int, str, int, int]:
    """By what steps are put in the order of their arrival."""
    event = stored.step.event
    return event.arrived, event.monitor, event.seq, stored.position


def is_undone(stored: StoredStep, undoing: Sequence[StreamKey]) -> bool:
    """Whether a step is of an event that was denied, of streams whose denied events count for themselves alone."""
    stream = stored.step.event.stream
    denied = stored.decision is not None and stored.decision.choice == "deny"
    return denied and stream in undoing


def _row(stored: StoredStep) -> BlockRow:
    step, event, stands = stored.step, stored.step.event, stored.standing
    return BlockRow(
        stored.position, stored.order, event.stream.name, event.stream.kind, step.stamp, event.arrived,
        int(step.skewed), int(step.late), event.lost, stored.decision.choice if stored.decision else None,
        stored.judged, _encode(step.signals).decode(), letters(stored.outcomes), _digits(stored.degraded),
        _whys(stored.explanations), None if stands is None else letters(stands.outcomes),
        None if stands is None else _digits(stands.degraded), None if stands is None else _whys(stands.explanations),
    )  # fmt: skip


def _digits(degraded: Sequence[bool]) -> str:
    return "".join(["1" if it else "0" for it in degraded])


def _whys(explanations: Mapping[int, object]) -> str | None:
    """Of explanations, by which properties there are any: their texts are not needed."""
    return _encode(dict.fromkeys(map(str, explanations), 0)).decode() if explanations else None


def plain(value: Any) -> Any:
    """A copy of a plain value as JSON carries it, as any other backend would give it back."""
    return msgspec.json.decode(msgspec.json.encode(value))


def without_data(stored: StoredStep) -> StoredStep:
    """A step as any backend keeps it."""
    event = msgspec.structs.replace(stored.step.event, data=None, stamp=stored.step.stamp, received=None)
    step = msgspec.structs.replace(stored.step, event=event)
    return msgspec.structs.replace(stored, step=step, explanations=plain_whys(stored.explanations))


def plain_whys(explanations: Mapping[int, ExplanationRecord]) -> dict[int, ExplanationRecord]:
    """Copies of explanations, likewise."""
    return {i: plain(why) for i, why in explanations.items()}


def made(make: Callable[[], T]) -> Callable[[], T]:
    """Gives what is made now, or raises what was raised."""
    try:
        value = make()
    except Exception as error:  # noqa: BLE001 -- it is raised again
        failure = error

        def fail() -> T:
            raise failure

        return fail
    return lambda: value
