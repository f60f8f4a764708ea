"""What `replay` prints: violations as they come and a table, or a verdict record a line."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from oracle_server.core.errors import TraceError
from oracle_server.core.spec import By
from oracle_server.core.verdicts import Judged, explain, record
from oracle_server.replay import Replay
from oracle_server.specfile import load_spec
from oracle_server.trace import Trace


def run_replay(spec_path: Path, trace_path: Path, by: By | None, *, as_json: bool) -> int:
    """Judge a trace and print what was found; the exit status: 0 no violation, 1 violated.

    Raises `SpecError` and `TraceError` where an input can't be used.
    """
    if trace_path.suffix != ".jsonl":
        raise TraceError(f"{trace_path}: this version reads traces in JSON Lines, named .jsonl")
    spec = load_spec(spec_path).spec
    trace = Trace(trace_path, spec)
    replay = Replay(spec, trace, by)
    write = _write_records if as_json else _write_violations
    with _progress(trace) as advance:
        for judged in replay:
            write(judged)
            advance()
    if as_json:
        sys.stdout.write(_json({"summary": replay.summary()}))
    else:
        _print_summary(replay)
    for name, count in sorted(trace.ignored.items()):
        sys.stderr.write(f"oracle-server: ignored {count} events of '{name}', which {spec.id} does not observe\n")
    sys.stdout.flush()
    return 1 if replay.violated else 0


def _write_records(judged: Judged) -> None:
    for verdict in judged.verdicts:
        sys.stdout.write(_json(record(judged, verdict)))


def _write_violations(judged: Judged) -> None:
    for verdict in judged.verdicts:
        why = explain(judged, verdict)
        if why:
            order = " by arrival" if judged.order == "arrival" else ""
            sys.stdout.write(f"violation {verdict.n}{order}: {why['text']}\n")


def _print_summary(replay: Replay) -> None:
    summary = replay.summary()
    table = Table("property", "outcome", "violations", "first at", "unknown", box=None, pad_edge=False)
    for name, state in summary["properties"].items():
        cells = (state["outcome"], state["violations"], state["first_violation"] or "-", state["unknown"])
        table.add_row(name, *map(str, cells))
    console = Console(file=sys.stdout, highlight=False, width=None if sys.stdout.isatty() else 160)
    console.print(table)
    console.print(f"{summary['events']} events, {summary['violations']} violations, {summary['late']} late")


@contextmanager
def _progress(trace: Trace) -> Iterator[Any]:
    """A bar on standard error, where a person watches; yields what to call now and then."""
    if not sys.stderr.isatty():
        yield lambda: None
        return
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(trace.path.name, total=trace.path.stat().st_size)
        yield lambda: progress.update(task, completed=trace.read)


def _json(value: object) -> str:
    return msgspec.json.encode(value).decode() + "\n"
