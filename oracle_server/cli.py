"""The command line: `oracle-server check`, `replay` and what reads a running server."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

import typer

from oracle_server import __version__
from oracle_server.core.errors import OracleError, SpecError
from oracle_server.rosgraph import load_graph
from oracle_server.specfile import load_spec

app = typer.Typer(
    name="oracle-server",
    help="An oracle that watches robots: past-time temporal logic over ROS messages and services.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


class By(StrEnum):
    """An order of events."""

    PUBLICATION = "publication"
    ARRIVAL = "arrival"
    BOTH = "both"


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context, version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False
) -> None:
    if version:
        typer.echo(f"oracle-server {__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


_ROS: dict[str, Literal[1, 2]] = {"1": 1, "2": 2}


class RosVersion(StrEnum):
    """A version of ROS."""

    ONE = "1"
    TWO = "2"


@app.command()
def check(
    specs: Annotated[list[Path], typer.Argument(metavar="SPEC…", help="Spec files.")],
    ros: Annotated[RosVersion | None, typer.Option(help="Warn of what this version of ROS lacks.")] = None,
    ros_graph: Annotated[Path | None, typer.Option(help="A dump of the robot's graph, to find deadlocks by.")] = None,
) -> None:
    """Validate specs: schema, expressions, formulas, ordering hazards."""
    graph = load_graph(ros_graph) if ros_graph else None
    sound = True
    for path in specs:
        try:
            loaded = load_spec(path, _ROS[ros] if ros else None, graph)
        except SpecError as error:
            sound = False
            typer.echo(str(error), err=True)
        else:
            for warning in loaded.warnings:
                typer.echo(str(warning), err=True)
            typer.echo(f"{path}: sound")
    if not sound:
        raise typer.Exit(1)


@app.command()
def replay(
    spec: Annotated[Path, typer.Argument(metavar="SPEC", help="A spec file.")],
    trace: Annotated[Path, typer.Argument(metavar="TRACE", help="A recorded trace (.jsonl).")],
    by: Annotated[By | None, typer.Option(help="The order to judge in; default: as the spec says.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print a verdict record a line, and a summary.")] = False,
) -> None:
    """Judge a recorded trace offline, through the same session code as the server."""
    from oracle_server.report import run_replay

    raise typer.Exit(run_replay(spec, trace, by.value if by else None, as_json=as_json))


@app.command()
def serve(
    specs: Annotated[Path | None, typer.Option(help="The folder of the specs; default ./specs.")] = None,
    data_dir: Annotated[Path | None, typer.Option(help="Where the history is kept.")] = None,
    host: Annotated[str | None, typer.Option(help="The address to bind; default 127.0.0.1.")] = None,
    port: Annotated[int | None, typer.Option(min=0, max=65535, help="The port; default 8642.")] = None,
    legacy: Annotated[str | None, typer.Option(metavar="SPEC", help="The spec of ROSMonitoring's monitors.")] = None,
) -> None:
    """Run the server in the foreground, until SIGTERM or SIGINT."""
    from oracle_server.server import serve as run
    from oracle_server.settings import load_settings

    run(load_settings(specs=specs, data_dir=data_dir, host=host, port=port, legacy=legacy))


Url = Annotated[str, typer.Option(envvar="ORACLE_URL", help="The server's address.")]
Token = Annotated[str | None, typer.Option(envvar="ORACLE_TOKEN", help="The server's token.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
_DEFAULT_URL = "http://127.0.0.1:8642"


@app.command("specs")
def list_specs(url: Url = _DEFAULT_URL, token: Token = None, as_json: AsJson = False) -> None:
    """List the specs that a running server has on hand."""
    from oracle_server.client import Client, show_specs

    show_specs(Client(url, token), as_json=as_json)


@app.command()
def sessions(url: Url = _DEFAULT_URL, token: Token = None, as_json: AsJson = False) -> None:
    """List the sessions of a running server."""
    from oracle_server.client import Client, show_sessions

    show_sessions(Client(url, token), as_json=as_json)


@app.command()
def verdicts(
    session: Annotated[str, typer.Argument(metavar="SESSION")],
    property_: Annotated[list[str] | None, typer.Option("--property", help="Only this property; repeatable.")] = None,
    outcome: Annotated[list[str] | None, typer.Option(help="Only this outcome; repeatable.")] = None,
    url: Url = _DEFAULT_URL,
    token: Token = None,
    as_json: AsJson = False,
) -> None:
    """Print a session's verdicts: a summary and its violations, or the records that are asked for."""
    from oracle_server.client import Client, show_verdicts

    show_verdicts(Client(url, token), session, property_ or [], outcome or [], as_json=as_json)


def main() -> None:
    """Run the command line; an error is one line on standard error and exit status 2."""
    try:
        status = app(standalone_mode=False)
    except (typer.Abort, KeyboardInterrupt):
        sys.exit(130)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(0)
    except OracleError as error:
        sys.exit(_fail(str(error)))
    except Exception as error:
        usage = getattr(error, "format_message", None)  # typer's usage errors, whichever click it carries
        if usage is None:
            raise
        sys.exit(_fail(usage()))
    sys.exit(status if isinstance(status, int) else 0)


def _fail(message: str) -> int:
    typer.echo(f"oracle-server: {message}", err=True)
    return 2
