"""The command line: every command, and nothing of what it does."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from enum import StrEnum
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from oracle_server import __version__
from oracle_server.core.errors import OracleError, SpecError
from oracle_server.specfiles.load import load_spec
from oracle_server.specfiles.rosgraph import load_graph

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


class Form(StrEnum):
    """What a report is written as."""

    TEXT = "text"
    JSONL = "jsonl"
    CSV = "csv"
    JUNIT = "junit"


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
    specs: Annotated[list[Path], typer.Argument(metavar="SPEC…", help="Spec files.")],
    trace: Annotated[Path, typer.Argument(metavar="TRACE", help="A recording: .jsonl, .bag, .mcap, ROS 2 bag folder.")],
    by: Annotated[By | None, typer.Option(help="The order to judge in; default: as the spec says.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The same as --format jsonl.")] = False,
    form: Annotated[Form, typer.Option("--format", help="What to print.")] = Form.TEXT,
    types: Annotated[list[Path] | None, typer.Option(help="A folder with .msg files, for bags without.")] = None,
) -> None:
    """Judge a recording offline, through the same session code as the server."""
    from oracle_server.process.garbage import look_seldom
    from oracle_server.replay.command import run_replay

    look_seldom()
    chosen = Form.JSONL if as_json else form
    raise typer.Exit(run_replay(specs, trace, by.value if by else None, chosen.value, types or []))


AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
DataDir = Annotated[Path | None, typer.Option(help="Where the history is kept.")]
Within = Annotated[float, typer.Option(min=0.1, help="Seconds to wait.")]
_OF_A_SERVER: dict[str, Any] = {
    "specs": Annotated[Path | None, typer.Option("--specs", help="The folder of the specs; default ./specs.")],
    "data_dir": DataDir,
    "host": Annotated[str | None, typer.Option(help="The address to bind; default 127.0.0.1.")],
    "port": Annotated[int | None, typer.Option(min=0, max=65535, help="The port; default 8642.")],
    "legacy": Annotated[str | None, typer.Option(metavar="SPEC", help="The spec of ROSMonitoring's monitors.")],
    "tls_cert": Annotated[Path | None, typer.Option(help="The server's certificate (PEM), for TLS.")],
    "tls_key": Annotated[Path | None, typer.Option(help="The certificate's key (PEM).")],
    "tls_client_ca": Annotated[
        Path | None, typer.Option(help="Clients must show a certificate of this authority (PEM).")
    ],
    "insecure": Annotated[
        bool | None, typer.Option("--insecure", help="Be reachable by others without tokens or TLS.")
    ],
}
"""The settings that a server takes on its command line, in the foreground or in the background."""

_Command = Callable[..., None]


def _takes_settings(command: _Command) -> _Command:
    """Let a command take `_OF_A_SERVER` besides options of its own; it gets them as keywords, None where not given."""
    own = [p for p in signature(command).parameters.values() if p.kind is not Parameter.VAR_KEYWORD]
    settings = [
        Parameter(name, Parameter.KEYWORD_ONLY, default=None, annotation=kind) for name, kind in _OF_A_SERVER.items()
    ]
    command.__signature__ = Signature([*own, *settings])  # type: ignore[attr-defined]
    return command


@app.command()
@_takes_settings
def serve(**settings: Any) -> None:
    """Run the server in the foreground, until SIGTERM or SIGINT."""
    from oracle_server.process.settings import load_settings
    from oracle_server.server import serve as run

    run(load_settings(**settings))


@app.command()
@_takes_settings
def start(within: Within = 300.0, **settings: Any) -> None:
    """Run the server in the background; return once it accepts work."""
    from oracle_server.process.daemon import start as run
    from oracle_server.process.settings import load_settings

    run(load_settings(**settings), within)


@app.command()
def stop(data_dir: DataDir = None, within: Within = 60.0) -> None:
    """Stop the server of a data directory, once it has judged and committed what it holds."""
    from oracle_server.process.daemon import stop as run
    from oracle_server.process.settings import load_settings

    run(load_settings(data_dir=data_dir).data_dir, within)


@app.command()
def status(data_dir: DataDir = None, as_json: AsJson = False) -> None:
    """Tell how the server of a data directory stands; exit status 3 where none runs."""
    from oracle_server.process.daemon import status as tell
    from oracle_server.process.settings import load_settings

    raise typer.Exit(tell(load_settings(data_dir=data_dir).data_dir, as_json=as_json))


Url = Annotated[str, typer.Option(envvar="ORACLE_URL", help="The server's address.")]
Token = Annotated[str | None, typer.Option(envvar="ORACLE_TOKEN", help="The server's token.")]
_DEFAULT_URL = "http://127.0.0.1:8642"


@app.command("specs")
def list_specs(url: Url = _DEFAULT_URL, token: Token = None, as_json: AsJson = False) -> None:
    """List the specs that a running server has on hand."""
    from oracle_server.cli.client import Client
    from oracle_server.cli.tables import show_specs

    show_specs(Client(url, token), as_json=as_json)


@app.command()
def sessions(url: Url = _DEFAULT_URL, token: Token = None, as_json: AsJson = False) -> None:
    """List the sessions of a running server."""
    from oracle_server.cli.client import Client
    from oracle_server.cli.tables import show_sessions

    show_sessions(Client(url, token), as_json=as_json)


@app.command()
def verdicts(
    session: Annotated[str, typer.Argument(metavar="SESSION")],
    property_: Annotated[list[str] | None, typer.Option("--property", help="Only this property; repeatable.")] = None,
    outcome: Annotated[list[str] | None, typer.Option(help="Only this outcome; repeatable.")] = None,
    follow: Annotated[bool, typer.Option("--follow", help="Go on with what comes, until the session ends.")] = False,
    explain: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Say why verdict number N is as it is.")
    ] = None,
    url: Url = _DEFAULT_URL,
    token: Token = None,
    as_json: AsJson = False,
) -> None:
    """Print a session's verdicts: a summary and its violations, or the records that are asked for."""
    from oracle_server.cli.client import Client
    from oracle_server.cli.tables import follow_verdicts, show_explanation, show_verdicts

    if explain is not None:
        show_explanation(Client(url, token), session, explain, as_json=as_json)
        return
    if follow:
        follow_verdicts(Client(url, token), session, property_ or [], outcome or [], as_json=as_json)
        return
    show_verdicts(Client(url, token), session, property_ or [], outcome or [], as_json=as_json)


@app.command()
def streams(spec: Annotated[Path, typer.Argument(metavar="SPEC", help="A spec file.")]) -> None:
    """Print what an adapter has to observe for a spec, for its `--log` without a server."""
    import json

    from oracle_server.core.plan import plan
    from oracle_server.sessions.greeting import described

    ready = plan(load_spec(spec).spec)
    told = [described(ready, key) for key in ready.streams]
    document = {"spec": ready.spec.id, "spec_digest": ready.spec.digest, "streams": told}
    typer.echo(json.dumps(document, indent=2))


@app.command("import")
def import_(
    config: Annotated[Path, typer.Argument(metavar="CONFIG", help="A configuration of ROSMonitoring (.yaml).")],
    properties: Annotated[list[Path] | None, typer.Option(help="A property module; repeatable.")] = None,
    out: Annotated[Path | None, typer.Option("--output", "-o", help="The spec to write; default: print it.")] = None,
) -> None:
    """Write a spec from ROSMonitoring's configuration and property modules, which are read and never run."""
    from oracle_server.specfiles.rosmonitoring.write import import_config

    import_config(config, properties or [], out)


@app.command()
def record(
    session: Annotated[str, typer.Argument(metavar="SESSION")],
    out: Annotated[Path, typer.Option("--output", "-o", help="The file to write, .mcap or .jsonl.")],
    url: Url = _DEFAULT_URL,
    token: Token = None,
) -> None:
    """Store what the monitors of a session sent, for `replay`."""
    from oracle_server.cli.client import Client
    from oracle_server.cli.record import record_session

    record_session(Client(url, token), session, out)


tokens = typer.Typer(help="Who may use the server: tokens, of which it keeps hashes only.", add_completion=False)
app.add_typer(tokens, name="token")


class Scope(StrEnum):
    """What a token is good for."""

    SUBMIT = "submit"
    READ = "read"
    ADMIN = "admin"


@tokens.command("add")
def token_add(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Whose it is.")],
    scope: Annotated[list[Scope], typer.Option(help="What it is good for; repeatable.")],
    spec: Annotated[list[str] | None, typer.Option(help="Good for this spec only; repeatable.")] = None,
    session: Annotated[list[str] | None, typer.Option(help="Good for this session only; repeatable.")] = None,
    data_dir: DataDir = None,
) -> None:
    """Make a token and print it; it is shown this once. A server that runs knows it at once."""
    from oracle_server.edge.tokens import add
    from oracle_server.process.settings import load_settings

    typer.echo(add(load_settings(data_dir=data_dir).token_file, name, [s.value for s in scope], spec, session))


@tokens.command("remove")
def token_remove(name: Annotated[str, typer.Argument(metavar="NAME")], data_dir: DataDir = None) -> None:
    """Make a token good for nothing."""
    from oracle_server.edge.tokens import remove
    from oracle_server.process.settings import load_settings

    remove(load_settings(data_dir=data_dir).token_file, name)


@tokens.command("list")
def token_list(data_dir: DataDir = None, as_json: AsJson = False) -> None:
    """List the tokens: whose they are and what they are good for."""
    from oracle_server.cli.tables import show_tokens
    from oracle_server.edge.tokens import listed
    from oracle_server.process.settings import load_settings

    show_tokens(listed(load_settings(data_dir=data_dir).token_file), as_json=as_json)


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
    except Exception as error:
        usage = getattr(error, "format_message", None)  # typer's usage errors, whichever click it carries
        if usage is None:
            raise
        sys.exit(_fail(usage()))
    sys.exit(status if isinstance(status, int) else 0)


def _write_utf8() -> None:
    """Write UTF-8 whatever the locale, as JSON and XML have it; what has no place in it, escaped."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(encoding="utf-8", errors="backslashreplace")


def _fail(message: str) -> int:
    typer.echo(f"oracle-server: {message}", err=True)
    return 2
