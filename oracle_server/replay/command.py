"""The command `replay`: judges a recording by specs, and writes a report; shows progress on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from oracle_server.core.errors import OracleError, one_line
from oracle_server.core.events import By
from oracle_server.core.units import counted
from oracle_server.history.views import View
from oracle_server.process.progress import progress
from oracle_server.replay.conclusion import UNJUDGED, conclude, gravest
from oracle_server.replay.opening import refuse_swapped
from oracle_server.replay.preparing import doubtful, prepare, read_spec
from oracle_server.replay.report.formats import Format, Report, make_report
from oracle_server.replay.report.github import Marked
from oracle_server.replay.run import Replay
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.annotations import property_places

_EVERY = 256
_MOST_IGNORED = 20
"""Streams that no spec observes, and that are told by their names: a robot has hundreds."""


def run_replay(
    specs: Sequence[Path],
    trace: Path,
    by: By | None,
    form: Format,
    types: Sequence[Path] = (),
    *,
    strict: bool = False,
    signals: bool = False,
    view: View = "standing",
) -> int:
    """Judge a recording by each spec, and print the report; returns the exit status, the gravest of all specs.

    With `strict` whatever was not judged is no success; with `signals` a text report counts all signals. `view`: which
    verdicts are told of a spec that revises; a JUnit report tells those that stand. Raises `SpecError` and `TraceError`
    where an input can't be used.
    """
    marked: list[Marked] = []
    report = make_report(form, sys.stdout, several=len(specs) > 1, signals=signals, specs=marked)
    told: View = "standing" if form in ("junit", "github") else view
    statuses = []
    try:
        refuse_swapped(specs, trace)
        known = Types(types)
        loaded = [read_spec(path, known, by) for path in specs]
        marked += [Marked(str(path), property_places(file.text)) for path, file in zip(specs, loaded, strict=True)]
        for file in loaded:
            say(doubtful(file))
            replay = prepare(file, trace, by, types, known, strict=strict, view=told)
            _run(replay, report)
            statuses.append(_tell(replay, form))
    except OracleError as error:
        report.finish(str(error))
        raise
    report.finish()
    sys.stdout.flush()
    return gravest(statuses)


def _run(replay: Replay, report: Report) -> None:
    recording = replay.recording
    with progress(recording.path.name, "events", after=0) as show:
        for count, judged in enumerate(replay):
            report.judged(replay, judged)
            if count % _EVERY == 0:
                show(recording.read, recording.size or None, replay.events)
    report.ended(replay)


def _tell(replay: Replay, form: Format) -> int:
    """Say on standard error what the report has no place for; returns the exit status."""
    end = conclude(replay)
    lines = list(end.unusable)
    if form != "text" and end.status == UNJUDGED:
        lines += [f"{replay.spec.id}: {name} was not judged: {reason}" for name, reason in end.unjudged.items()]
        lines += [f"{replay.spec.id}: {doubt}" for doubt in end.doubts]
    if replay.events:
        lines += _ignored(replay)
    if end.status == UNJUDGED and not end.unjudged:
        lines.append(f"{replay.spec.id}: ends with {UNJUDGED} because of --strict: not everything was judged")
    say(lines)
    return end.status


def _ignored(replay: Replay) -> Iterator[str]:
    """What no stream of the spec observes, those first that have most where not all are told."""
    counts = {name: count for name, count in replay.recording.ignored.items() if count}
    told = sorted(counts, key=lambda name: (-counts[name], name))[:_MOST_IGNORED]
    for name in sorted(told):
        yield f"ignored {counted(counts[name], 'event')} of '{name}', which {replay.spec.id} does not observe"
    if len(counts) > len(told):
        more = sum(counts.values()) - sum(counts[name] for name in told)
        others = counted(len(counts) - len(told), "other stream")
        yield f"ignored {counted(more, 'event')} of {others}, which {replay.spec.id} does not observe"


def say(lines: Iterable[str]) -> None:
    """Say something on standard error, a line each."""
    sys.stderr.writelines(f"oracle-server: {one_line(line)}\n" for line in lines)
