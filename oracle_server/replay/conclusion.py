"""What a replay says as a whole: its exit status, and what could not be judged, with the reasons."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from oracle_server.core.errors import one_line
from oracle_server.core.events import StreamKey
from oracle_server.core.formula.tree import Atom, Signal
from oracle_server.core.judging.asked import told
from oracle_server.core.plan import can_meet
from oracle_server.core.ranges import ValueKind
from oracle_server.core.spec import SECOND, Property, Spec
from oracle_server.core.units import counted, span
from oracle_server.core.verdicts import Outcome
from oracle_server.replay.doubts.asked import unasked
from oracle_server.replay.doubts.coverage import Coverage, SignalCounts, because, kind_of, never_there, silent
from oracle_server.replay.recording import Note, part_of
from oracle_server.replay.run import Replay

SOUND, VIOLATED, UNUSABLE, UNJUDGED = 0, 1, 2, 3
"""The exit statuses of `replay`."""
_GRAVEST_FIRST = (UNUSABLE, VIOLATED, UNJUDGED, SOUND)
_BOTH: tuple[Literal["failed", "absent"], ...] = ("failed", "absent")
_MOST_TOPICS = 8
"""Topics of a recording that are named where it has none of the spec's."""


def gravest(statuses: list[int]) -> int:
    """The exit status that stands for several."""
    return min(statuses, key=_GRAVEST_FIRST.index, default=SOUND)


@dataclass(frozen=True, slots=True)
class Conclusion:
    """The exit status of one replay, and its reasons.

    `unusable` says why the recording can't be used, empty where it can; `unjudged` has properties that were
    not judged, with the reason; `doubts` is whatever else was not judged, and makes a strict replay fail; `remarks`
    is to be known, and changes no status. `warnings` are those of the spec's formulas, which are doubts, too.
    """

    status: int
    strict: bool
    unusable: tuple[str, ...]
    unjudged: dict[str, str]
    doubts: tuple[str, ...]
    warnings: tuple[str, ...]
    remarks: tuple[str, ...]
    coverage: Coverage

    def as_data(self) -> dict[str, Any]:
        """The conclusion as plain data, for a summary."""
        return {
            "exit": self.status,
            "streams": {str(key): counts for key, counts in self.coverage.items()},
            "silent": [str(key) for key in silent(self.coverage)],
            "unjudged": [{"property": name, "reason": reason} for name, reason in self.unjudged.items()],
            "notes": [*self.unusable, *self.doubts, *self.remarks],
            "doubts": [*self.unusable, *self.doubts],
            "warnings": list(self.warnings),
        }


def conclude(replay: Replay) -> Conclusion:
    """The conclusion of a replay that has ended."""
    coverage = replay.coverage
    notes = [*replay.recording.notes, *replay.delays.notes(clocked=replay.recording.clocked)]
    unusable = [note.text for note in notes if note.unusable]
    unusable += _misfits(replay.spec, coverage)
    if not replay.events and not unusable:
        unusable.append(_nothing_observed(replay))
    by_id = {prop.id: prop for prop in replay.spec.properties}
    unjudged = {
        name: _reason(replay, by_id[name], where, coverage)
        for name, where in replay.unjudged.items()
        if name not in replay.violated
    }
    for name, text in _unread(replay, notes):
        unjudged.setdefault(name, text)
    doubts = [note.text for note in notes if note.doubt and note.text not in unjudged.values()]
    ended = {*unjudged, *_ended(replay)}
    idle = [i for i in unasked(replay.spec, replay.session, coverage) if i.property.id not in ended]
    strange = list(dict.fromkeys(replay.vocabulary.doubts(idle)))
    doubts += _open_questions(replay, coverage, unjudged) if replay.events else []
    doubts += [text for _, text in strange]
    status = SOUND
    if unusable:
        status = UNUSABLE
    elif replay.violated:
        status = VIOLATED
    elif unjudged or (replay.strict and (doubts or replay.warnings)):
        status = UNJUDGED
    remarks = tuple(note.text for note in notes if not note.unusable and not note.doubt)
    remarks += tuple(f"{name}: judged from step {step} on, and unknown before" for name, step in replay.begun.items())
    remarks += tuple(told([(i.property.id, i.part) for i in idle if i.property.id not in dict(strange)]))
    remarks += tuple(replay.row_names.empty.told())
    if replay.revised:
        remarks += (replay.revised,)
    return Conclusion(
        status, replay.strict, tuple(unusable), unjudged, tuple(doubts), replay.warnings, remarks, coverage
    )


def still_open(replay: Replay) -> list[str]:
    """The properties of which obligations are open at the end, and how many, each in a line."""
    return [
        f"{name}: {counted(state['pending'], 'obligation')} still open at the end"
        for name, state in replay.states().items()
        if state.get("pending")
    ]


def _ended(replay: Replay) -> Iterator[str]:
    """The properties that were violated, or of which not all was looked at: they were decided, or given up."""
    yield from replay.violated
    for name, state in replay.states().items():
        if state["outcome"] != Outcome.CURRENTLY_TRUE.value:
            yield name.removesuffix(" (arrival)")


def _unread(replay: Replay, notes: Sequence[Note]) -> Iterator[tuple[str, str]]:
    """The properties that were not judged at messages which could not be read, each with the reason."""
    for note in notes:
        for index in sorted(replay.readers(note.unread)):
            name = replay.spec.properties[index].id
            if name not in replay.violated:
                yield name, note.text


def _open_questions(replay: Replay, coverage: Coverage, unjudged: dict[str, str]) -> Iterator[str]:
    """What was not judged though it could have been: streams without events, signals that never were, unknown steps."""
    for key in silent(coverage):
        near = _nearest(key.name, list(replay.recording.ignored))
        yield f"{key}: no event in the recording" + (f"; it has {near[0]}" if near else "")
    for key, name in never_there(coverage):
        counts = coverage[key]["signals"][name]
        how = "failed" if counts["failed"] > counts["absent"] else "was absent"
        why = because(counts) if how == "failed" else ""
        yield f"{key}: the signal {name} {how} at {_all(coverage[key]['events'])}{why}"
    yield from _incomparable(replay, coverage)
    yield from _too_short(replay)
    yield from replay.spelling.doubts()
    yield from replay.fields.doubts()
    yield from replay.row_names.doubts()
    yield from replay.lacking.doubts()
    yield from replay.apart.doubts()
    yield from replay.units.doubts()
    yield from replay.leaps.doubts()
    if replay.skipped:
        yield f"{counted(replay.skipped, 'late event')} {_was(replay.skipped)} skipped, and not judged"
    if replay.forced:
        what = counted(replay.forced, "event")
        yield f"{what} {_was(replay.forced)} judged before older ones may have come: `capacity` was reached"
    timed = [prop.id for prop in replay.spec.properties if prop.time == "seconds"]
    if timed and not replay.recording.clocked:
        yield f"no deadline of {', '.join(timed)} was judged by itself: the recording has no times of arrival"
    for name, state in replay.states().items():
        if state["unknown"] and name not in unjudged:
            yield f"{name}: unknown at {counted(state['unknown'], 'step')}"


def _incomparable(replay: Replay, coverage: Coverage) -> Iterator[str]:
    """The signals that a property compares with values of a kind which they never had, and with no others."""
    for prop in replay.spec.properties:
        for stream in replay.spec.streams:
            compared: dict[str, set[ValueKind | None]] = {}
            for atom in prop.atoms:
                for name, kind in _compared(atom) if can_meet(stream, atom) else ():
                    compared.setdefault(name, set()).add(kind)
            for name in coverage[stream.key]["signals"]:
                had, wanted = replay.kinds(stream.key, name), compared.get(name, {None})
                if had and None not in wanted and not had & wanted:
                    was, other = (" or a ".join(sorted(map(str, kinds))) for kinds in (had, wanted))
                    signal = f"{stream.key}: the signal {name}"
                    yield f"{signal} was always a {was}, and {prop.id} compares it with a {other}"


def _too_short(replay: Replay) -> Iterator[str]:
    """The properties of rates that were never known, since the recording is shorter than what they are taken over."""
    session = replay.session
    if session is None or session.begun is None:
        return
    lasted = session.now - session.begun
    for prop in replay.spec.properties:
        read = set(replay.spec.derived_of(prop))
        for each in reversed(replay.spec.derive):  # each may be computed of those above it
            if each.name not in read:
                continue
            read.update(each.reads)
            if each.op == "rate" and each.over is not None and lasted < each.over:
                yield (
                    f"{prop.id}: {each.name} was never known: a rate is {span(each.over)} after the begin, and the "
                    f"recording lasts {lasted / SECOND:g} s"
                )


def _compared(atom: Atom) -> Iterator[tuple[str, ValueKind | None]]:
    """The signals that an atom compares, each with the kind of what it is compared with; None for any."""
    ordered = {c.value.name for c in atom.constraints if isinstance(c.value, Signal)}
    for constraint in atom.constraints:
        if isinstance(constraint.value, Signal):
            yield constraint.key, "number"
        elif constraint.key not in ordered:
            yield constraint.key, kind_of(constraint.value)
    yield from ((name, "number") for name in ordered)


def _was(count: int) -> str:
    return "was" if count == 1 else "were"


def _misfits(spec: Spec, coverage: Coverage) -> Iterator[str]:
    """The streams with messages that can't be of their types."""
    for key, counts in coverage.items():
        if "misfits" in counts:
            which = part_of(counts["misfits"], counts["events"])
            yield f"{key}: {which} no {spec.by_key[key].type}: {counts['misfit']}"


def _all(events: int) -> str:
    return "its only event" if events == 1 else f"all its {events} events"


def _nothing_observed(replay: Replay) -> str:
    recording, spec = replay.recording, replay.spec
    there = {name: count for name, count in recording.ignored.items() if count}
    wanted = [str(stream.key) for stream in spec.streams]
    path = recording.path
    if not there:
        return f"{path}: has no event at all; {spec.id} observes {', '.join(wanted)}"
    near = list(dict.fromkeys(n for stream in spec.streams for n in _nearest(stream.name, list(there))))
    names = near + sorted((name for name in there if name not in near), key=lambda name: (-there[name], name))
    shown = ", ".join(f"{one_line(name)} ({counted(there[name], 'event')})" for name in names[:_MOST_TOPICS])
    more = f" and {len(names) - _MOST_TOPICS} more" if len(names) > _MOST_TOPICS else ""
    return f"{path}: has no event of {spec.id}, which observes {', '.join(wanted)}; it has {shown}{more}"


def _nearest(name: str, others: list[str]) -> list[str]:
    """The names that may be meant: those in another namespace, else those that are alike."""
    own = f"/{name.strip('/')}"
    elsewhere = sorted(other for other in others if other.endswith(own) or own.endswith(f"/{other.strip('/')}"))
    return elsewhere[:3] or difflib.get_close_matches(name, others, n=3, cutoff=0.7)


def _reason(replay: Replay, prop: Property, where: Sequence[StreamKey], coverage: Coverage) -> str:
    """Why a property was not judged, at the events of these streams or, without any, at all."""
    why = _why_unknown(replay, prop, coverage)
    return f"unknown at every event of {' and '.join(map(str, where))}: {why}" if where else why


def _why_unknown(replay: Replay, prop: Property, coverage: Coverage) -> str:
    session = replay.session
    states = [s for j in session.judges.values() for s in j.properties if s.property is prop] if session else []
    for state in states:
        if state.broken is not None or state.complaint is not None:
            return one_line(state.broken or state.complaint or "")
    index = replay.spec.properties.index(prop)
    views = {key: stream.views[index] for key, stream in session.plan.streams.items()} if session else {}
    reads = frozenset[str]().union(*(view.reads for view in views.values()))
    lacking = list(_lacking(coverage, reads, prop))
    if lacking:
        return "; ".join(lacking)
    if session and any(judge.counters.skipped for judge in session.judges.values()):
        return "all its events were late, and skipped"
    return "no step could be judged"


def _lacking(coverage: Coverage, reads: frozenset[str], prop: Property) -> Iterator[str]:
    """The signals that a property reads and that failed, or for a formula over numbers were absent."""
    for key, counts in coverage.items():
        for name, signal in counts["signals"].items():
            for how in _BOTH if prop.numeric else _BOTH[:1]:
                if name in reads and signal[how]:
                    yield _lack(key, name, how, signal, counts["events"])


def _lack(key: StreamKey, name: str, how: Literal["failed", "absent"], signal: SignalCounts, events: int) -> str:
    verb, why = ("failed", because(signal)) if how == "failed" else ("was absent", "")
    return f"the signal {name} of {key} {verb} at {signal[how]} of {counted(events, 'event')}{why}"
