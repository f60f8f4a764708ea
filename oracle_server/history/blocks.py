"""Blocks: what a run of rows comes to, so that a question by time reads a few of them and not all rows.

A block of level 0 is of `SIZE` positions, one of each further level of `FANOUT` blocks of the level below. Those of a
level are numbered 0, 1, 2… from the session's first position. Only rows of the order that decides count, and no
revisions. Their time is the latest of any of them so far: so blocks never overlap, and what came late is where it was
judged. Times are integer nanoseconds.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from typing import Any, NamedTuple

import msgspec

from oracle_server.core.events import Order, StreamKey
from oracle_server.core.kinds import REVISION, TICK, StepKind

SIZE, FANOUT, LEVELS = 32, 8, 6
BEFORE = -1
"""The time before a session's first row."""

_GRAVITY = "-TtufF"
"""The letters of outcomes, the gravest last."""
_RANKED = str.maketrans(_GRAVITY, "012345")
_LETTERED = str.maketrans("012345", _GRAVITY)
_UNBYPASSED = str.maketrans("2", "1")
_LONGEST = 100
"""Characters of a text that a sketch keeps: of a longer one it says that there are several."""
_AT_ONCE = 100_000
"""Characters of signals that are read at once: a tenth of a millisecond."""
_BEYOND = 1e300
"""Sums stop here: JSON has no infinities."""
_whys = msgspec.json.Decoder(dict[str, msgspec.Raw]).decode
_signals = msgspec.json.Decoder(dict[str, Any]).decode
_all_signals = msgspec.json.Decoder(list[dict[str, Any]]).decode

Sketch = list[Any]
"""Of a signal's values: how many are numbers (or `true` and `false`, as 1 and 0), the least, the largest and their sum;
then, where some are texts, that text, or None where there are several."""


class BlockRow(NamedTuple):
    """What blocks are made of, as rows of the history have it: JSON in `signals` and explanations, letters, digits."""

    position: int
    order: Order
    stream: str
    kind: str
    stamp: int
    arrived: int
    skewed: int
    late: int
    lost: int
    decision: str | None
    judged: int
    signals: str
    outcomes: str
    degraded: str
    explanations: str | None
    standing: str | None
    standing_degraded: str | None
    standing_explanations: str | None


_Columns = Any
"""A `BlockRow` of columns."""


class StreamTally(msgspec.Struct, array_like=True, gc=False):
    """What came on a stream, how much of it was lost before that, and a sketch of each signal."""

    count: int
    lost: int
    signals: dict[str, Sketch]


class Tally(msgspec.Struct, array_like=True, gc=False):
    """What is counted: steps, late ones, violations by the property's index, asks, denials, how long asks waited."""

    steps: int = 0
    late: int = 0
    violations: dict[str, int] = {}
    asked: int = 0
    denied: int = 0
    held: int = 0
    longest: int = 0
    streams: dict[str, StreamTally] = {}
    """By `str(StreamKey)`."""


_tally = msgspec.json.Decoder(Tally).decode


@dataclass(slots=True)
class Block:
    """A run of rows: the times of its first and last one, the worst outcome of each property, and which were degraded.

    Where none of its rows count, the times are those of the row before it, and the texts are empty.
    """

    since: int
    until: int
    worst: str
    degraded: str
    data: Tally | str
    """A `Tally`, or its JSON as long as nobody has asked for it."""

    @property
    def tally(self) -> Tally:
        """What is counted."""
        return _tally(self.data) if isinstance(self.data, str) else self.data

    @property
    def text(self) -> str:
        """The same as JSON."""
        return self.data if isinstance(self.data, str) else msgspec.json.encode(self.data).decode()


def positions(level: int) -> int:
    """How many positions a block of a level has."""
    return SIZE * int(FANOUT**level)


def of_rows(rows: Sequence[BlockRow], since: int, decides: Order, *, signals: bool = True) -> Block:
    """The block of consecutive rows, behind one whose time was `since`; with sketches of signals if wanted."""
    columns = zip(*rows, strict=True) if rows else [()] * len(BlockRow._fields)
    return of_columns([*columns], since, decides, signals=signals)


def of_columns(found: Sequence[Any], since: int, decides: Order, *, signals: bool = True) -> Block:
    """The same of the columns of `BlockRow`: it is quicker than row by row."""
    columns: _Columns = BlockRow._make(found)
    if columns.order.count(decides) < len(columns.order) or REVISION in columns.kind:
        counting = [BlockRow._make(row) for row in zip(*found, strict=True) if row[1] == decides and row[3] != REVISION]
        return of_rows(counting, since, decides, signals=signals)
    if not columns.position:
        return Block(since, since, "", "", Tally())
    own = columns.stamp
    if any(columns.skewed):
        own = [a if skewed else s for a, s, skewed in zip(columns.arrived, own, columns.skewed, strict=True)]
    outcomes = _standing(columns.outcomes, columns.standing, columns.standing)
    degraded = _standing(columns.degraded, columns.standing_degraded, columns.standing)
    violations = _violations(_standing(columns.explanations, columns.standing_explanations, columns.standing))
    tally = Tally(len(own), sum(columns.late), violations, *_asked(columns), _streams(columns, signals))
    return Block(max(since, own[0]), max(since, *own), worst_of(outcomes), degraded_of(degraded), tally)


def timed(rows: Sequence[BlockRow], since: int, decides: Order) -> list[tuple[int, BlockRow]]:
    """The rows that count of consecutive ones, with their times, of which none is before `since`."""
    found = []
    for row in rows:
        _, order, _, kind, stamp, arrived, skewed, *_ = row
        if order == decides and kind != REVISION:
            since = max(since, arrived if skewed else stamp)
            found.append((since, row))
    return found


def merged(blocks: Sequence[Block]) -> Block:
    """The block of some consecutive ones, one at least."""
    tallies = [block.tally for block in blocks]
    violations: dict[str, int] = {}
    streams: dict[str, StreamTally] = {}
    for tally in tallies:
        for index, count in tally.violations.items():
            violations[index] = violations.get(index, 0) + count
        for name, stream in tally.streams.items():
            add_stream(streams, name, stream)
    tally = Tally(
        sum([t.steps for t in tallies]), sum([t.late for t in tallies]), violations, sum([t.asked for t in tallies]),
        sum([t.denied for t in tallies]), sum([t.held for t in tallies]), max([t.longest for t in tallies]), streams,
    )  # fmt: skip
    worst, degraded = worst_of([b.worst for b in blocks]), degraded_of([b.degraded for b in blocks])
    return Block(blocks[0].since, blocks[-1].until, worst, degraded, tally)


def add_stream(streams: dict[str, StreamTally], name: str, more: StreamTally) -> None:
    """Add what came on a stream to what is known of it."""
    known = streams.get(name)
    if known is None:
        streams[name] = StreamTally(more.count, more.lost, more.signals.copy())
        return
    known.count += more.count
    known.lost += more.lost
    for signal, sketch in more.signals.items():
        had = known.signals.get(signal)
        known.signals[signal] = sketch if had is None else both(had, sketch)


def both(one: Sketch, other: Sketch) -> Sketch:
    """The sketch of the values of two."""
    if not one[0] or not other[0]:
        found = (one if one[0] else other)[:4]
    else:
        total = max(-_BEYOND, min(one[3] + other[3], _BEYOND))
        found = [one[0] + other[0], min(one[1], other[1]), max(one[2], other[2]), total]
    texts = {sketch[4] for sketch in (one, other) if len(sketch) > 4}
    if texts:
        found.append(texts.pop() if len(texts) == 1 else None)
    return found


def worst_of(outcomes: Collection[str]) -> str:
    """The worst outcome of each property, of texts with a letter for each."""
    texts = {*outcomes}
    texts.discard("")
    if len(texts) < 2:
        return texts.pop() if texts else ""
    return "".join(map(max, zip(*[text.translate(_RANKED) for text in texts], strict=True))).translate(_LETTERED)


def degraded_of(digits: Collection[str]) -> str:
    """Which properties were degraded, of texts with a digit for each."""
    texts = {*digits}
    texts.discard("")
    if len(texts) < 2:
        return texts.pop().translate(_UNBYPASSED) if texts else ""
    return "".join(map(max, zip(*texts, strict=True))).translate(_UNBYPASSED)


def _standing(said: Sequence[Any], stands: Sequence[Any], revised: Sequence[str | None]) -> Sequence[Any]:
    """What stands in each row, of what it said, what stands since it was revised, and whether it was."""
    if revised.count(None) == len(revised):
        return said
    return [a if r is None else b for a, b, r in zip(said, stands, revised, strict=True)]


def _violations(explanations: Sequence[str | None]) -> dict[str, int]:
    if explanations.count(None) == len(explanations):
        return {}
    return dict(Counter(chain.from_iterable([_whys(whys) for whys in explanations if whys is not None])))


def _asked(columns: _Columns) -> tuple[int, int, int, int]:
    """How many asked, how many of them were denied, how long they waited in all, and at most (ns)."""
    if columns.decision.count(None) == len(columns.decision):
        return 0, 0, 0, 0
    found = zip(columns.decision, columns.judged, columns.arrived, strict=True)
    holds = [max(0, judged - arrived) for decision, judged, arrived in found if decision is not None]
    return len(holds), columns.decision.count("deny"), sum(holds), max(holds)


def _streams(columns: _Columns, signals: bool) -> dict[str, StreamTally]:
    texts: defaultdict[tuple[str, str], list[str]] = defaultdict(list)
    keys = [*zip(columns.stream, columns.kind, strict=True)]
    for key, text in zip(keys, columns.signals, strict=True):
        texts[key].append(text)
    lost: Counter[tuple[str, str]] = Counter()
    if any(columns.lost):
        for key, count in zip(keys, columns.lost, strict=True):
            lost[key] += count
    return {
        stream_name(*key): StreamTally(len(found), lost[key], _sketches(found) if signals else {})
        for key, found in texts.items()
        if key[1] != TICK
    }


@lru_cache(1_000)
def stream_name(name: str, kind: StepKind) -> str:
    """A stream as it is called in what is counted."""
    return str(StreamKey(name, kind))


def _sketches(signals: Sequence[str]) -> dict[str, Sketch]:
    values: defaultdict[str, list[Any]] = defaultdict(list)
    for each in _read(signals):
        for name, value in each.items():
            values[name].append(value)
    return {name: _sketch(found) for name, found in values.items()}


def _read(signals: Sequence[str]) -> list[dict[str, Any]]:
    """The signals of rows: at once, which is faster, or one by one where that would hold the interpreter for long."""
    if sum(map(len, signals)) <= _AT_ONCE:
        return _all_signals(f"[{','.join(signals)}]")
    return [_signals(each) for each in signals]


def _sketch(values: Sequence[Any]) -> Sketch:
    kinds = {*map(type, values)}
    if str not in kinds:
        return _of_numbers(values)
    texts = {value for value in values if isinstance(value, str)}
    found = _of_numbers([value for value in values if not isinstance(value, str)]) if len(kinds) > 1 else [0, 0, 0, 0]
    text = texts.pop()
    return [*found, None if texts or len(text) > _LONGEST else text]


def _of_numbers(values: Sequence[float]) -> Sketch:
    total = max(-_BEYOND, min(float(sum(values)), _BEYOND))
    return [len(values), min(values) + 0, max(values) + 0, total]  # 0 makes numbers of `true` and `false`
