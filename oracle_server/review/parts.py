"""What each part of a formula came to at the steps around a verdict: the session is judged again up to these.

The whole is what was recorded. A part is not told where judging again does not come out as that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypedDict

from oracle_server.core.events import Order
from oracle_server.core.formula.outline import Row, outline
from oracle_server.core.formula.tree import Atom, Scalar
from oracle_server.core.kinds import NAMING, RESERVED
from oracle_server.core.spec import SECOND, Property
from oracle_server.core.verdicts import json_number
from oracle_server.engines.table import ENGINES
from oracle_server.history.port import Reading
from oracle_server.history.records import SessionRecord, StoredStep
from oracle_server.history.views import said
from oracle_server.review.again import GONE, NoExplanationError, judge_in_thread, plan_of
from oracle_server.review.watching import Found, Looked, Seen, Truth, WatchingSpan
from oracle_server.review.watching_revised import WatchingRevised

MOST_STEPS, MOST_ROWS = 1_000, 200
_MOST_VALUES = 100_000
"""Truths that are computed for one answer."""
_LONGEST = 100
"""Characters of a text among the values."""


class PartRecord(TypedDict):
    """A part of a formula; `runs` are its truths and `values` those of its `signal`, each from an index of steps on."""

    path: list[int]
    depth: int
    head: str
    text: str
    name: str | None
    needs: list[str]
    waits: bool
    more: bool
    runs: list[tuple[int, Truth]]
    signal: str | None
    values: list[tuple[int, Scalar | None]]


class PartsRecord(TypedDict):
    """The parts of a property's formula by time; see the model of the API."""

    n: int
    property: str
    order: Order
    formula: str
    at: int
    times: list[int]
    numbers: list[int]
    steps: list[int | None]
    outcomes: list[tuple[int, str]]
    robustness: list[Any] | None
    parts: list[PartRecord]
    note: str | None
    earlier: bool
    later: bool


@dataclass(frozen=True, slots=True)
class Around:
    """Which steps around a verdict are wanted: `within` ns of it, and so many of them on each side at the most."""

    n: int
    within: int
    steps: int


async def parts(history: Reading, opened: SessionRecord, around: Around) -> PartsRecord | None:
    """The parts of the formula of verdict `n`'s property around it, None where there is no such verdict.

    This takes as long as judging all steps before it, in a thread, and can be cancelled. Raises `NoExplanationError`
    or `HistoryError`.
    """
    width = len(opened.properties)
    before, index = divmod(around.n - 1, width)
    target = await history.step(opened.number, before + 1)
    if target is None:
        return None
    if target.revision is not None:
        raise NoExplanationError(f"verdict {around.n} is a revision, and no step")
    if said(target, "standing").outcomes[index] is None:
        raise NoExplanationError(f"verdict {around.n} does not stand: its deadline would not have run out")
    ready = await history.in_thread(partial(plan_of, opened))
    prop = ready.spec.properties[index]
    rows = await history.in_thread(partial(outline, prop.formula, prop.time, MOST_ROWS))
    explicable = ENGINES[prop.engine].explicable
    most = min(around.steps, MOST_STEPS // 2, max(1, _MOST_VALUES // (2 * len(rows))))
    first, last = await history.extent(opened.number)
    looked = Looked(ready, index, opened, target, rows if explicable else rows[:1])
    if ready.spec.ordering.late == "revise":
        times = await _times(history, looked, around.within)
        revised = WatchingRevised(looked, times, most)
        await _judge_revised(history, revised, first)
        return await history.in_thread(lambda: _record(revised.found.within(around.within), looked, around))
    span = range(max(first, target.position - most), min(last, target.position + most) + 1)
    again = WatchingSpan(looked, range(first, last + 1), span)
    if explicable:
        await _judge_again(history, again, first)
    else:
        async for page in history.steps(opened.number, span.start - 1, span.stop - 1):
            await history.in_thread(partial(again.take, page))
    return await history.in_thread(lambda: _record(again.found.within(around.within), looked, around))


async def _judge_again(history: Reading, again: WatchingSpan, first: int) -> None:
    session = again.opened.number
    snapshot = await history.snapshot(session)
    if snapshot is not None and not first - 1 <= snapshot.position < again.target.position:
        snapshot = None
    if snapshot is not None and snapshot.position >= again.span.start:
        if first == 1:
            snapshot = None
        else:
            again.span = range(snapshot.position + 1, again.span.stop)
    position = await history.in_thread(partial(again.begin, snapshot))
    if position < first - 1:
        raise NoExplanationError(GONE)
    async for page in history.steps(session, position, again.span.stop - 1):
        await judge_in_thread(history, again, page, position)
        position = page[-1].position
    if position < again.target.position:
        raise NoExplanationError(GONE)


async def _judge_revised(history: Reading, again: WatchingRevised, first: int) -> None:
    """Judge again until no late event can change what is told: these come behind what they change."""
    session = again.opened.number
    snapshot = await history.snapshot(session)
    if snapshot is not None and not first - 1 <= snapshot.position < again.target.position:
        snapshot = None
    position = await history.in_thread(partial(again.begin, again.demand(snapshot, whole=first == 1)))
    if position < first - 1:
        raise NoExplanationError(GONE)
    async for page in history.steps(session, position):
        await judge_in_thread(history, again, page, position)
        position = page[-1].position
        if again.is_done:
            break
    if position < again.target.position:
        raise NoExplanationError(GONE)


async def _times(history: Reading, looked: Looked, within: int) -> range:
    """The times (ns) so close to the target's, where the spec revises.

    What has no place by its own time stands at the latest one before it.
    """
    target, streams = looked.target, looked.ready.streams

    def is_placed(stored: StoredStep) -> bool:
        is_ordered = stored.is_tick or streams[stored.step.event.stream].spec.ordered
        return stored.place is not None or (is_ordered and not stored.step.late)

    if is_placed(target):
        return range(target.step.time - within, target.step.time + within + 1)
    pages = history.steps(looked.opened.number, max(0, target.position - 1 - MOST_STEPS), target.position)
    before = [step.step.time async for page in pages for step in page if step.revision is None and is_placed(step)]
    time, within = max(before, default=target.step.time), within + SECOND
    return range(time - within, time + within + 1)


def _record(found: Found, looked: Looked, around: Around) -> PartsRecord:
    """What was found, as it is told."""
    seen, index = found.seen, looked.index
    prop, width = looked.ready.spec.properties[index], len(looked.opened.properties)
    steps = [each.stored for each in seen]
    measured = [step.robustness[index] if step.robustness else None for step in steps]
    return {
        "n": around.n,
        "property": prop.id,
        "order": looked.target.order,
        "formula": prop.text,
        "at": found.at,
        "times": [step.step.time for step in steps],
        "numbers": [(step.position - 1) * width + index + 1 for step in steps],
        "steps": [step.number for step in steps],
        "outcomes": _runs([each.outcome.value for each in seen]),
        "robustness": None if measured.count(None) == len(measured) else [json_number(each) for each in measured],
        "parts": [_part(row, place, seen) for place, row in enumerate(looked.rows)],
        "note": _note(prop),
        "earlier": found.earlier,
        "later": found.later,
    }


def _part(row: Row, place: int, found: Sequence[Seen]) -> PartRecord:
    signal = _signal(row)
    return {
        "path": list(row.path),
        "depth": row.depth,
        "head": row.head,
        "text": row.text,
        "name": row.name,
        "needs": list(row.needs),
        "waits": row.waits,
        "more": row.more,
        "runs": _runs([seen.truths[place] for seen in found]),
        "signal": signal,
        "values": [] if signal is None else _runs([_short(seen.signals.get(signal)) for seen in found]),
    }


def _signal(row: Row) -> str | None:
    """The signal whose values tell most of an atom: the first that it reads beside those that name events."""
    if not isinstance(row.part, Atom):
        return None
    return next((c.key for c in row.part.constraints if c.key not in NAMING | RESERVED), None)


def _short(value: Scalar | None) -> Scalar | None:
    return f"{value[:_LONGEST]}…" if isinstance(value, str) and len(value) > _LONGEST else value


def _runs(values: Sequence[Any]) -> list[tuple[int, Any]]:
    """The values where they change, each with its index."""
    return [(i, v) for i, v in enumerate(values) if not i or (type(v), v) != (type(values[i - 1]), values[i - 1])]


def _note(prop: Property) -> str | None:
    if ENGINES[prop.engine].explicable:
        return None
    return f"engine '{prop.engine}' does not tell the parts of its formulas: only the outcome is shown"
