"""All commands of the command line, and the entry point."""

from __future__ import annotations

import io
import sys
from typing import Annotated

import typer

from oracle_server import __version__
from oracle_server.cli import history, reading, replay, serving, specs, token
from oracle_server.core.errors import OracleError, one_line

app = typer.Typer(
    name="oracle-server",
    help="An oracle that watches robots: past-time temporal logic over ROS messages and services.",
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
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
    """Run the command line; an error is one line on standard error and exit status 2."""
    _write_utf8()
    try:
        status = app(standalone_mode=False)
    except (typer.Abort, KeyboardInterrupt):
        sys.exit(130)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(0)
    except OracleError as error:
        sys.exit(_fail(str(error)))
    except ModuleNotFoundError as error:
        if error.name not in _POSIX:
            raise
        sys.exit(_fail("this needs Linux or macOS; `check`, `replay` and what reads a running server work here, too"))
    except Exception as error:
        usage = getattr(error, "format_message", None)  # a usage error of click, of which typer may have its own copy
        if usage is None:
            raise
        sys.exit(_fail(usage()))
    sys.exit(status if isinstance(status, int) else 0)


def _write_utf8() -> None:
    """Write UTF-8 whatever the locale, as JSON and XML need it; escape characters that UTF-8 can't represent."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(encoding="utf-8", errors="backslashreplace")


def _fail(message: str) -> int:
    typer.echo("\n".join(map(one_line, f"oracle-server: {message}".split("\n"))), err=True)
    return 2
