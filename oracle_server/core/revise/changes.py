"""What stands otherwise after steps were judged again: changes of runs of verdicts, and the rows that tell of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from operator import is_
from typing import NamedTuple

import msgspec

from oracle_server.core.events import REVISIONS, Event, Step
from oracle_server.core.records import ExplanationRecord
from oracle_server.core.revise.kept import Kept
from oracle_server.core.revisions import MOST_CAUSES, Change, Revision, Standing
from oracle_server.core.verdicts import Choice, Decision, Judged, Outcome, Verdict, explain


class Again(NamedTuple):
    """A row before and after it was judged again: how it stood and how it stands, None where it is retracted.

    `position` is the row's, `before` that of the row before it that is no revision. `would` is what the decision on its
    event would be now, None where that is what was decided, or nothing was.
    """

    position: int
    before: int
    stood: Judged
    stands: Judged | None
    would: Decision | None = None


def differing(stood: Mapping[int, Kept], stands: Mapping[int, tuple[Judged, Decision | None]]) -> list[Again]:
    """The rows that stand otherwise than they stood, by position: most do not. `stands` are those that stand still."""
    return [
        Again(position, row.preceding, row.judged, judged, would)
        for position, row in sorted(stood.items())
        for judged, would in [stands.get(position, (None, None))]
        if judged is not row.judged or would is not None
    ]


class _Run(NamedTuple):
    """Consecutive verdicts of one property with the same change."""

    key: tuple[Outcome, Outcome | None, bool, bool]
    first: int
    last: int
    position: int
    violation: bool
    retracted: bool
    decision: Choice | None
    explanation: ExplanationRecord | None


def revisions(
    again: Sequence[Again], properties: Sequence[str], because: Sequence[Event], now: int, numbers: Iterator[int]
) -> list[Revision]:
    """The rows for what changed among rows that were judged again, by position; each takes a number a property.

    `because` are the late events, the oldest first, and `now` is the time of judgement (ns).
    """
    oldest, late = because[0], _messages(because)
    stamp = oldest.arrived if oldest.stamp is None else oldest.stamp
    runs = [list(_runs(i, again)) for i in range(len(properties))]
    rows: list[Revision] = []
    for row in range(max((len(own) for own in runs), default=0)):
        taken = [next(numbers) for _ in properties]
        changes = [
            _change(own[row], n, name) if row < len(own) else None
            for own, n, name in zip(runs, taken, properties, strict=True)
        ]
        position = (taken[0] - 1) // len(properties) + 1
        event = Event(REVISIONS, "", -position, None, oldest.arrived, None)
        rows.append(
            Revision(
                step=Step(event, {}, frozenset(), stamp),
                number=None,
                order=again[0].stood.order,
                judged=now,
                verdicts=(),
                decision=None,
                first=taken[0],
                changes=tuple(changes),
                because=late[:MOST_CAUSES],
                causes=len(late),
                standing={} if row else _standing(again),
            )
        )
    return rows


def _messages(events: Sequence[Event]) -> tuple[Event, ...]:
    """The events, each once, however many rows it has."""
    return tuple({(e.monitor, e.stream, e.seq): e for e in events}.values())


def _change(run: _Run, n: int, name: str) -> Change:
    _, outcome, _, degraded = run.key
    return Change(
        n, name, run.first, run.last, outcome, degraded, run.violation, run.retracted, run.decision, run.explanation
    )


def _runs(index: int, again: Sequence[Again]) -> Iterator[_Run]:
    run: _Run | None = None
    for row in again:
        found = _run(index, row)
        if found is None:
            if run is not None:
                yield run
            run = None
        elif (
            run is not None
            and run.key == found.key
            and run.position == row.before
            and not (found.violation or found.retracted or found.decision)
        ):
            run = run._replace(last=found.last, position=found.position)
        else:
            if run is not None:
                yield run
            run = found
    if run is not None:
        yield run


def _run(index: int, row: Again) -> _Run | None:
    """What changed of one property's verdict at a row, None where nothing did."""
    if not _differs(index, row):
        return None
    stood = row.stood.verdicts[index]
    stands = None if row.stands is None else row.stands.verdicts[index]
    was, is_now = stood.explanation is not None, stands is not None and stands.explanation is not None
    outcome, degraded = (None, stood.degraded) if stands is None else (stands.outcome, stands.degraded)
    why = None
    if is_now and not was and row.stands is not None and stands is not None:
        why = explain(row.stands, stands)
    decision = row.would.choice if row.would is not None and _decides_otherwise(row, stood.property) else None
    key = (stood.outcome, outcome, stood.degraded, degraded)
    return _Run(key, stood.n, stood.n, row.position, is_now and not was, was and not is_now, decision, why)


def _differs(index: int, row: Again) -> bool:
    stood = row.stood.verdicts[index]
    if row.stands is None:
        return True
    stands = row.stands.verdicts[index]
    return (
        stands.outcome is not stood.outcome
        or stands.degraded is not stood.degraded
        or (stands.explanation is None) is not (stood.explanation is None)
        or _decides_otherwise(row, stood.property)
    )


def _decides_otherwise(row: Again, name: str) -> bool:
    """Whether a property would deny an event that it did not deny, or would not that it did."""
    decided, would = row.stood.decision, row.would
    return decided is not None and would is not None and (name in decided.denied_by) is not (name in would.denied_by)


def _standing(again: Sequence[Again]) -> Mapping[int, Standing]:
    """What stands of the rows that changed, by their positions."""
    width = len(again[0].stood.verdicts) if again else 0
    return {row.position: _stands(row) for row in again if any(_differs(i, row) for i in range(width))}


def _stands(row: Again) -> Standing:
    if row.stands is None:
        return Standing((None,) * len(row.stood.verdicts), tuple([v.degraded for v in row.stood.verdicts]))
    verdicts = row.stands.verdicts
    whys = ((i, explain(row.stands, verdict)) for i, verdict in enumerate(verdicts))
    return Standing(
        tuple([v.outcome for v in verdicts]),
        tuple([v.degraded for v in verdicts]),
        {i: why for i, why in whys if why is not None},
    )


def merged(old: tuple[Verdict, ...], new: tuple[Verdict, ...]) -> tuple[Verdict, ...]:
    """Verdicts that stand: degraded where they were, and where they are by more than what is bypassed at present.

    They are `old` itself where nothing has changed.
    """
    found = [_merge(was, verdict) for was, verdict in zip(old, new, strict=True)]
    return old if all(map(is_, old, found)) else tuple(found)


def _merge(old: Verdict, new: Verdict) -> Verdict:
    degraded = old.degraded or (new.degraded and not new.bypassed)
    if new.outcome is old.outcome and degraded is old.degraded and new.explanation is old.explanation:
        return old
    return msgspec.structs.replace(new, degraded=degraded, bypassed=old.bypassed)
