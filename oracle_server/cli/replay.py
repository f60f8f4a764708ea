"""The command `replay`: judges a recording offline."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from oracle_server.cli.options import TypeFolders
from oracle_server.core.errors import OracleError
from oracle_server.process.ending import ended_as_by_ctrl_c


class By(StrEnum):
    """The order in which events are judged."""

    PUBLICATION = "publication"
    ARRIVAL = "arrival"
    BOTH = "both"


class Form(StrEnum):
    """The format of the report."""

    TEXT = "text"
    JSONL = "jsonl"
    CSV = "csv"
    JUNIT = "junit"
    GITHUB = "github"


class View(StrEnum):
    """Which verdicts are told where the spec revises."""

    STANDING = "standing"
    FIRST = "first"
    ALL = "all"


class Engine(StrEnum):
    """Where many recordings are judged."""

    LOCAL = "local"
    RAY = "ray"


@ended_as_by_ctrl_c()
def replay(
    paths: Annotated[
        list[Path],
        typer.Argument(metavar="SPEC… RECORDING", help="Specs and a recording; with --on, recordings and folders."),
    ],
    by: Annotated[By | None, typer.Option(help="The order to judge in; default: that of the spec.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The same as --format jsonl.")] = False,
    form: Annotated[Form, typer.Option("--format", help="The format of the report.")] = Form.TEXT,
    types: TypeFolders = None,
    strict: Annotated[bool, typer.Option("--strict", help="End with 3 where anything was not judged.")] = False,
    signals: Annotated[bool, typer.Option("--signals", help="Count how often each signal was there.")] = False,
    view: Annotated[
        View, typer.Option("--as", help="Of a spec that revises: what stands, what was said at first, or all of it.")
    ] = View.STANDING,
    on: Annotated[
        list[Path] | None,
        typer.Option("--on", metavar="SPEC…", help="Judge many recordings by these specs: a row each and property."),
    ] = None,
    jobs: Annotated[
        int | None, typer.Option("-j", "--jobs", metavar="N", min=1, help="Processes for many recordings; default: 1.")
    ] = None,
    engine: Annotated[Engine | None, typer.Option(help="Processes of this machine, or those of a Ray cluster.")] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="A table (.parquet, .jsonl, .csv) of many recordings, which is gone on with."
        ),
    ] = None,
    timeout: Annotated[
        str | None,
        typer.Option(metavar="DURATION", help="The longest for one of many recordings and one spec; default: 1h."),
    ] = None,
    serve: Annotated[
        bool, typer.Option("--serve", help="Show it in the dashboard, by a server of its own, until Ctrl-C.")
    ] = False,
) -> None:
    """Judge a recording offline, through the same session code as the server; or, with --on, many recordings.

    Ends with 0 where nothing was violated, 1 where something was, 2 where an input can't be used or has no event of
    the spec, and 3 where a property could not be judged. Where the spec revises, what stands at the end counts.
    """
    import structlog

    structlog.configure(logger_factory=structlog.PrintLoggerFactory(sys.stderr))  # the report is on standard output
    chosen = Form.JSONL if as_json else form
    for_many = any(option is not None for option in (jobs, engine, out, timeout))
    if serve:
        if any((by, strict, signals, on, for_many, chosen is not Form.TEXT, view is not View.STANDING)):
            raise OracleError("--serve shows one recording as its spec has it: leave out all other options but --types")
        raise typer.Exit(_served(paths, types or []))
    if on is not None:
        from oracle_server.replay.many.command import Where, run_many

        if signals or view is not View.STANDING:
            raise OracleError("--signals and --as are for one recording: `replay SPEC… RECORDING`")
        where = Where(engine.value if engine else "local", jobs, _duration(timeout))
        more, recordings = _apart(paths)
        status = run_many(
            recordings,
            on + more,
            by.value if by else None,
            chosen.value,
            types or [],
            strict=strict,
            out=out,
            where=where,
        )
        raise typer.Exit(status)

    from oracle_server.process.garbage import collect_rarely
    from oracle_server.replay.command import run_replay

    if for_many:
        raise OracleError("-j, --engine, --out and --timeout are for many: `replay RECORDING… --on SPEC…`")
    specs, trace = _named(paths)
    collect_rarely()
    status = run_replay(
        specs,
        trace,
        by.value if by else None,
        chosen.value,
        types or [],
        strict=strict,
        signals=signals,
        view=view.value,
    )
    raise typer.Exit(status)


def _served(paths: list[Path], types: list[Path]) -> int:
    from oracle_server.cli.showing import show_recording

    return show_recording(*_named(paths), types)


def _named(paths: list[Path]) -> tuple[list[Path], Path]:
    """The specs and the recording."""
    *specs, trace = paths
    if not specs:
        raise OracleError("Missing argument: `replay SPEC… RECORDING`, or `replay RECORDING… --on SPEC…`")
    return specs, trace


def _apart(paths: list[Path]) -> tuple[list[Path], list[Path]]:
    """Specs and recordings: of `--on a.yaml b.yaml` the second one stands among the recordings."""
    from oracle_server.replay.opening import is_spec

    specs = [path for path in paths if is_spec(path)]
    recordings = [path for path in paths if path not in specs]
    if not recordings:
        raise OracleError("no recording is named: `replay RECORDING… --on SPEC…`")
    return specs, recordings


def _duration(text: str | None) -> int:
    from oracle_server.core.units import duration

    try:
        return duration(text if text is not None else "1h")
    except ValueError as error:
        raise OracleError(f"--timeout: {error}") from None
