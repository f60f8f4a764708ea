"""The events around a moment, as a sequence diagram draws them: who sent what, what was decided of it, and when."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, TypedDict

from oracle_server.core.errors import OracleError
from oracle_server.core.events import Order, Released
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.kinds import GOAL_ID, KINDS, STATUS, StepKind
from oracle_server.core.records import WaitedRecord
from oracle_server.core.verdicts import NEGATIVE, Outcome, waited_record
from oracle_server.history.port import Reading
from oracle_server.history.records import SessionRecord, StoredStep
from oracle_server.history.views import said
from oracle_server.review.again import plan_of

MOST = 200
"""Events in one answer."""
_LOOKED_AT = 5_000
"""Rows that are looked at on each side, of which most may be of other streams."""
_AT_FIRST, _AT_ONCE = 50, 500
"""Rows that are read at first, and at once at the most: they may be large."""
_MOST_SIGNALS, _LONGEST = 6, 100
_MOST_VIOLATED = 10
_GRAVEST = (Outcome.FALSE, Outcome.CURRENTLY_FALSE, Outcome.UNKNOWN, Outcome.CURRENTLY_TRUE, Outcome.TRUE)


class NowhereError(OracleError):
    """There is no such place in a session; `n` is the verdict that its history does not have."""

    def __init__(self, opened: SessionRecord, n: int) -> None:
        super().__init__(f"session '{opened.id}' has no verdict {n} in its history")
        self.n = n


class ViolatedRecord(TypedDict):
    """A property that is violated at an event, with the number of its verdict."""

    property: str
    n: int


class ItemRecord(TypedDict):
    """An event or a deadline of a diagram; see the model of the API."""

    n: int
    outcome: str
    step: int | None
    stamp: int
    arrived: int
    held: int | None
    released: Released | None
    waited: list[WaitedRecord]
    stream: str
    kind: StepKind
    monitor: str
    seq: int
    row: int | None
    source: str
    call: int | None
    goal_id: str | None
    status: str | None
    late: bool
    skewed: bool
    judged: bool
    lost: int
    asked: bool
    decision: str | None
    denied_by: list[str]
    passed: bool | None
    violated: list[ViolatedRecord]
    signals: dict[str, Scalar]
    more_signals: int


class SequenceRecord(TypedDict):
    """A diagram; see the model of the API."""

    order: Order
    items: list[ItemRecord]
    left_out: int
    earlier: int | None
    later: int | None


@dataclass(frozen=True, slots=True)
class Wanted:
    """Which events are wanted: `limit` around verdict `n` or a time (ns), before a verdict, or after one.

    `property`: only those of streams that it reads or guards, and its own deadlines, unless `others` are wanted too.
    """

    n: int | None = None
    at: int | None = None
    before: int | None = None
    after: int | None = None
    limit: int = 40
    property: str | None = None
    others: bool = False


async def sequence(history: Reading, opened: SessionRecord, wanted: Wanted) -> SequenceRecord:
    """The events that are wanted, in the order in which they were judged.

    The property is one of the session's. Raises `NowhereError` where there is no such verdict.
    """
    index = None if wanted.property is None else opened.properties.index(wanted.property)
    chosen = None if wanted.others else index
    readers = {} if chosen is None else (await history.in_thread(partial(plan_of, opened))).readers  # may take seconds
    first, last = await history.extent(opened.number)
    center, order = await _center(history, opened, wanted, range(first, last + 1))
    simulated = any(monitor.clock == "sim" for monitor in await history.monitors(opened.number))
    take = partial(_concerns, readers, chosen, order)
    item = partial(_item, properties=opened.properties, index=index, simulated=simulated)
    find = partial(_find, history, opened.number, range(first, last + 1), partial(_looked_at, take, item))
    if wanted.before is not None:
        found = await find(center - 1, wanted.limit, forwards=False)
    elif wanted.after is not None:
        found = await find(center + 1, wanted.limit, forwards=True)
    else:
        ahead = await find(center, wanted.limit - wanted.limit // 2, forwards=True)
        back = await find(center - 1, wanted.limit - len(ahead.items), forwards=False)
        found = back.joined(ahead)
    width = len(opened.properties)
    span = found.span
    return {
        "order": order,
        "items": [*found.items],
        "left_out": found.left_out,
        "earlier": (span.start - 1) * width + 1 if first < span.start else None,
        "later": (span.stop - 1) * width if span.stop <= last else None,
    }


async def _center(history: Reading, opened: SessionRecord, wanted: Wanted, kept: range) -> tuple[int, Order]:
    """The position that is asked for, and the order in which events are told there."""
    if wanted.at is not None:
        return await _position_at(history, opened.number, wanted.at, kept), opened.decides
    n = next((n for n in (wanted.n, wanted.before, wanted.after) if n is not None), None)
    if n is None:
        return kept.stop, opened.decides
    position = (n - 1) // len(opened.properties) + 1
    step = await history.step(opened.number, position)
    if step is None:
        raise NowhereError(opened, n)
    return position, step.order


async def _position_at(history: Reading, session: int, time: int, kept: range) -> int:
    """The first position of a time (ns) or later: late events, which are behind younger ones, are not looked for."""
    low, high = kept.start, kept.stop
    while low < high:
        middle = (low + high) // 2
        step = await history.step(session, middle)
        if step is not None and step.step.time >= time:
            high = middle
        else:
            low = middle + 1
    return low


@dataclass(frozen=True, slots=True)
class _Found:
    """Events in a span of positions that was looked at, and how many others are between them."""

    items: Sequence[ItemRecord]
    span: range
    left_out: int

    def joined(self, later: _Found) -> _Found:
        """These, and what comes behind them."""
        span = range(self.span.start, later.span.stop)
        return _Found([*self.items, *later.items], span, self.left_out + later.left_out)


class _LookedAt(NamedTuple):
    """What is left of a row: its position, whether it is wanted, and what is told of it if it is."""

    position: int
    wanted: bool | None
    item: ItemRecord | None


async def _find(
    history: Reading, session: int, kept: range, look: Callable[[Sequence[StoredStep]], list[_LookedAt]], begin: int,
    most: int, *, forwards: bool,
) -> _Found:  # fmt: skip
    """So many events at a position and behind it, or before it."""
    found: list[ItemRecord] = []
    left_out, at, looked, size = 0, begin, 0, _AT_FIRST
    while len(found) < most and at in kept and looked < _LOOKED_AT:
        span = range(at, min(at + size, kept.stop)) if forwards else range(max(at - size + 1, kept.start), at + 1)
        page: list[_LookedAt] = []
        async for steps in history.steps(session, span.start - 1, span.stop - 1):
            page += await history.in_thread(partial(look, steps))
        for position, wanted, item in page if forwards else reversed(page):
            looked, at = looked + 1, position + (1 if forwards else -1)
            if item is not None:
                found.append(item)
            left_out += wanted is False
            if len(found) == most:
                break
        if not page:
            break
        size = min(2 * size, _AT_ONCE)
    return (
        _Found(found, range(begin, at), left_out)
        if forwards
        else _Found(found[::-1], range(at + 1, begin + 1), left_out)
    )


def _looked_at(
    take: Callable[[StoredStep], bool | None], item: Callable[[StoredStep], ItemRecord], steps: Sequence[StoredStep]
) -> list[_LookedAt]:
    """What is left of rows once they were looked at, which may be large."""
    found = [(step, take(step)) for step in steps]
    return [_LookedAt(step.position, wanted, item(step) if wanted else None) for step, wanted in found]


def _concerns(
    readers: Mapping[str, Collection[int]], index: int | None, order: Order, stored: StoredStep
) -> bool | None:
    """Whether a step is wanted; None for what is no event: rows of another order, revisions, others' deadlines."""
    if stored.order != order or stored.revision is not None:
        return None
    if stored.is_tick:
        violated = said(stored, "standing").explanations
        return True if (index in violated if index is not None else violated) else None
    return index is None or index in readers.get(stored.step.event.stream.name, ())


def _item(stored: StoredStep, *, properties: Sequence[str], index: int | None, simulated: bool) -> ItemRecord:
    step, event = stored.step, stored.step.event
    first = (stored.position - 1) * len(properties) + 1
    stands = said(stored, "standing")
    explanations, told = stands.explanations, [outcome or Outcome.UNKNOWN for outcome in stands.outcomes]
    chosen = min(range(len(told)), key=lambda i: _GRAVEST.index(told[i])) if index is None else index
    marks = (GOAL_ID, STATUS) if KINDS[event.stream.kind].marks else ()
    own = {} if stored.is_tick else {name: value for name, value in step.signals.items() if name not in marks}
    return {
        "n": first + chosen,
        "outcome": told[chosen].value,
        "step": stored.number,
        "stamp": step.stamp,
        "arrived": event.arrived,
        "held": None if simulated or stored.is_tick else max(0, stored.judged - event.arrived),
        "released": step.released,
        "waited": [waited_record(source) for source in step.waited],
        "stream": event.stream.name,
        "kind": event.stream.kind,
        "monitor": event.monitor,
        "seq": event.seq,
        "row": event.row,
        "source": event.source,
        "call": event.call,
        "goal_id": event.goal_id,
        "status": event.status,
        "late": step.late,
        "skewed": step.skewed,
        "judged": stored.is_tick or not step.skipped,
        "lost": event.lost,
        "asked": event.ask,
        "decision": stored.decision.choice if stored.decision else None,
        "denied_by": list(stored.decision.denied_by) if stored.decision else [],
        "passed": stored.passed,
        "violated": [
            {"property": properties[i], "n": first + i}
            for i in sorted(explanations)[:_MOST_VIOLATED]
            if told[i] in NEGATIVE
        ],
        "signals": {name: _short(own[name]) for name in list(own)[:_MOST_SIGNALS]},
        "more_signals": max(0, len(own) - _MOST_SIGNALS),
    }


def _short(value: Scalar) -> Scalar:
    return f"{value[:_LONGEST]}…" if isinstance(value, str) and len(value) > _LONGEST else value
