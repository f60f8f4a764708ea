"""The command `replay`: judges a recording offline."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from oracle_server.cli.options import SpecFiles, TypeFolders


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


class View(StrEnum):
    """Which verdicts are told where the spec revises."""

    STANDING = "standing"
    FIRST = "first"
    ALL = "all"


def replay(
    specs: SpecFiles,
    trace: Annotated[Path, typer.Argument(metavar="TRACE", help="A recording: a bag, a log, or a recorded session.")],
    by: Annotated[By | None, typer.Option(help="The order to judge in; default: that of the spec.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The same as --format jsonl.")] = False,
    form: Annotated[Form, typer.Option("--format", help="The format of the report.")] = Form.TEXT,
    types: TypeFolders = None,
    strict: Annotated[bool, typer.Option("--strict", help="End with 3 where anything was not judged.")] = False,
    signals: Annotated[bool, typer.Option("--signals", help="Count how often each signal was there.")] = False,
    view: Annotated[
        View, typer.Option("--as", help="Of a spec that revises: what stands, what was said at first, or all of it.")
    ] = View.STANDING,
) -> None:
    """Judge a recording offline, through the same session code as the server.

    Ends with 0 where nothing was violated, 1 where something was, 2 where an input can't be used or has no event of
    the spec, and 3 where a property could not be judged. Where the spec revises, what stands at the end counts.
    """
    import structlog

    from oracle_server.process.garbage import collect_rarely
    from oracle_server.replay.command import run_replay

    structlog.configure(logger_factory=structlog.PrintLoggerFactory(sys.stderr))  # the report is on standard output
    collect_rarely()
    chosen = Form.JSONL if as_json else form
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
