"""The command `replay`: judges a recording by specs, and writes a report; shows progress on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

from oracle_server.core.spec import By
from oracle_server.replay.formats import Format, Report, make_report
from oracle_server.replay.opening import open_recording
from oracle_server.replay.recording import Recording
from oracle_server.replay.run import Replay
from oracle_server.specfiles.load import load_spec

_EVERY = 256


def run_replay(specs: Sequence[Path], trace: Path, by: By | None, form: Format, types: Sequence[Path] = ()) -> int:
    """Judge a recording by each spec, and print the report; returns the exit status: 1 for a violation, else 0.

    Raises `SpecError` and `TraceError` where an input can't be used.
    """
    loaded = [load_spec(path).spec for path in specs]
    report = make_report(form, sys.stdout, several=len(loaded) > 1)
    violated = False
    for spec in loaded:
        recording = open_recording(trace, spec, types)
        replay = Replay(spec, recording, by)
        _run(replay, recording, report)
        violated = violated or replay.violated
        for name, count in sorted(recording.ignored.items()):
            sys.stderr.write(f"oracle-server: ignored {count} events of '{name}', which {spec.id} does not observe\n")
    report.finish()
    sys.stdout.flush()
    return 1 if violated else 0


def _run(replay: Replay, recording: Recording, report: Report) -> None:
    with _progress(recording) as advance:
        for count, judged in enumerate(replay):
            report.judged(replay, judged)
            if count % _EVERY == 0:
                advance()
    report.ended(replay)


@contextmanager
def _progress(recording: Recording) -> Iterator[Callable[[], None]]:
    """Show a progress bar on standard error, if that is a terminal; yields the function that updates it."""
    if not sys.stderr.isatty():
        yield lambda: None
        return
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(recording.path.name, total=recording.size)
        yield lambda: progress.update(task, completed=recording.read, total=recording.size)
