"""All commands of the command line, and the entry point."""

from __future__ import annotations

import contextlib
import gc
import io
import os
import sys
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from oracle_server import __version__
from oracle_server.cli import history, reading, replay, serving, specs, token
from oracle_server.cli.unforeseen import unforeseen
from oracle_server.core.errors import OracleError, one_line
from oracle_server.process.shortage import shortage

_CUT_OFF = 128 + 13
"""The exit status where whatever reads the output has ended, as `head` does: a shell's for SIGPIPE."""


class CutOffError(OracleError):
    """The output can't be written any more. As an OSError it would be 1 by the library, which says "violated"."""


class _Commands(TyperGroup):
    """The commands, of which none ends for a reader that is gone as if it had found something."""

    def invoke(self, ctx: Any) -> Any:
        """Run one."""
        try:
            return super().invoke(ctx)
        except BrokenPipeError:
            raise CutOffError from None


app = typer.Typer(
    name="oracle-server",
    cls=_Commands,
    help="An oracle that watches robots: temporal logic over ROS messages, services and actions.",
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
_STARTING = 20_000
"""New objects between two collections of garbage; by Python's default of 700 they take a fifth of a command's start."""
_NOWHERE = "No usable temporary directory"
"""What Python says where it finds no folder for temporary files."""
_POSIX = {"fcntl", "resource"}
"""Modules that Windows lacks, and that only what runs a server imports."""
histories = typer.Typer(help="What is done with histories that no server uses.", add_completion=False)
tokens = typer.Typer(help="Manage the tokens of a server, which stores only their hashes.", add_completion=False)


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context, version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False
) -> None:
    if version:
        typer.echo(f"oracle-server {__version__}")
        raise typer.Exit
    _show_commands(context)


@histories.callback(invoke_without_command=True)
@tokens.callback(invoke_without_command=True)
def _show_commands(context: typer.Context) -> None:
    """Say which commands there are where none is given."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


app.command()(specs.init)
app.command()(specs.check)
app.command()(specs.schema)
app.command()(replay.replay)
app.command()(serving.serve)
app.command()(serving.start)
app.command()(serving.stop)
app.command()(serving.status)
app.command("specs")(reading.specs)
app.command()(reading.sessions)
app.command()(reading.top)
app.command()(reading.verdicts)
app.command()(reading.episodes)
app.command()(specs.streams)
app.command("import")(specs.import_)
app.command()(reading.record)
app.command()(reading.put)
app.command()(reading.close)
app.add_typer(histories, name="history")
histories.command()(history.copy)
app.add_typer(tokens, name="token")
tokens.command()(token.add)
tokens.command()(token.remove)
tokens.command("list")(token.list_)


def main() -> None:
    """Run the command line; an error is one line on standard error and exit status 2, as 1 says "violated"."""
    gc.set_threshold(_STARTING)
    _open_standard_streams()
    _write_utf8()
    if os.environ.get("COLUMNS") == "0":  # as shells say that it is not known; into so many nothing would be printed
        del os.environ["COLUMNS"]
    try:
        status = app(standalone_mode=False)
        sys.stdout.flush()  # what can't be written is told of, too
    except (typer.Abort, KeyboardInterrupt):
        sys.exit(130)
    except (BrokenPipeError, CutOffError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python writes what is left, and would fail
        sys.exit(_CUT_OFF)
    except Exception as error:
        if sys.flags.dev_mode and not isinstance(error, OracleError):
            raise
        sys.exit(_fail(_reason(error)))
    sys.exit(status if isinstance(status, int) else 0)


def _open_standard_streams() -> None:
    """Let nothing be read from, and written to, standard streams that are closed, as by `>&-`.

    What is opened next would have their numbers, and Python has None in their place.
    """
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free, which is this one
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115 -- open to the end


def _write_utf8() -> None:
    """Write UTF-8 whatever the locale, as JSON and XML need it; escape characters that UTF-8 can't represent."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(encoding="utf-8", errors="backslashreplace")


def _reason(error: Exception) -> str:
    """Why a command could not do what it should: something that is foreseen, or else a defect and where it is."""
    usage = getattr(error, "format_message", None)  # a usage error of click, of which typer may have its own copy
    if isinstance(error, OracleError):
        return str(error)
    if isinstance(error, ModuleNotFoundError) and error.name in _POSIX:
        return "this needs Linux or macOS; `check`, `replay` and what reads a running server work here, too"
    if usage is not None:
        return " ".join(str(usage()).replace("Value error, ", "").split())  # a choice is in several lines, with tabs
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename is not None else "can't go on: "
        advice = "; name a folder that you can write by TMPDIR" if _NOWHERE in str(error) else ""
        return f"{where}{error.strerror or error}{advice}"
    return shortage(error) or unforeseen(error)


def _fail(message: str) -> int:
    """Say something on standard error; returns the exit status."""
    with contextlib.suppress(OSError):
        typer.echo("\n".join(map(one_line, f"oracle-server: {message}".split("\n"))), err=True)
    try:
        sys.stdout.flush()
    except OSError:  # what is left of the output would be written at the end again, which changes the exit status
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 2
