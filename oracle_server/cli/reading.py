"""The commands for a running server: `specs`, `sessions`, `verdicts`, `episodes`, `record`, `put` and `close`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from oracle_server.cli.options import AsJson, SpecFiles

UrlOption = Annotated[str, typer.Option(envvar="ORACLE_URL", help="The server's address.")]
TokenOption = Annotated[str | None, typer.Option(envvar="ORACLE_TOKEN", help="The server's token.")]
OriginOption = Annotated[
    str | None, typer.Option(metavar="ROBOT", help="Only what is forwarded from the robot of this name.")
]
_DEFAULT_URL = "http://127.0.0.1:8642"


class View(StrEnum):
    """Which verdicts are printed."""

    STANDING = "standing"
    FIRST = "first"
    ALL = "all"


def specs(url: UrlOption = _DEFAULT_URL, token: TokenOption = None, as_json: AsJson = False) -> None:
    """List the specs of a running server."""
    from oracle_server.cli.client import Client
    from oracle_server.cli.tables import show_specs

    show_specs(Client(url, token), as_json=as_json)


def sessions(
    watch: Annotated[bool, typer.Option("--watch", help="Draw them again every 2 s, until Ctrl-C.")] = False,
    origin: OriginOption = None,
    url: UrlOption = _DEFAULT_URL,
    token: TokenOption = None,
    as_json: AsJson = False,
) -> None:
    """List the sessions of a running server."""
    from oracle_server.cli.client import Client
    from oracle_server.cli.tables import show_sessions
    from oracle_server.cli.top import watch_sessions

    if watch and not as_json:
        watch_sessions(Client(url, token), origin)
    else:
        show_sessions(Client(url, token), origin, as_json=as_json)


def top(url: UrlOption = _DEFAULT_URL, token: TokenOption = None) -> None:
    """Show what goes on: open sessions with their rates, held events and open episodes, every 2 s, until Ctrl-C."""
    from oracle_server.cli.client import Client
    from oracle_server.cli.top import show_top

    show_top(Client(url, token))


def verdicts(
    session: Annotated[str, typer.Argument(metavar="SESSION")],
    property_: Annotated[list[str] | None, typer.Option("--property", help="Only this property; repeatable.")] = None,
    outcome: Annotated[list[str] | None, typer.Option(help="Only this outcome; repeatable.")] = None,
    follow: Annotated[bool, typer.Option("--follow", help="Print new verdicts, until the session ends.")] = False,
    explain: Annotated[int | None, typer.Option(metavar="N", min=1, help="Explain verdict number N.")] = None,
    view: Annotated[
        View, typer.Option("--as", help="What stands; what was said at first; or all, with revisions.")
    ] = View.STANDING,
    url: UrlOption = _DEFAULT_URL,
    token: TokenOption = None,
    as_json: AsJson = False,
) -> None:
    """Print a session's verdicts: a summary and its violations, or the selected records."""
    from oracle_server.cli.client import Client
    from oracle_server.cli.tables import follow_verdicts, show_explanation, show_verdicts

    if explain is not None:
        show_explanation(Client(url, token), session, explain, view, as_json=as_json)
        return
    show = follow_verdicts if follow else show_verdicts
    show(Client(url, token), session, property_ or [], outcome or [], view, as_json=as_json)


def episodes(
    session: Annotated[
        str | None, typer.Argument(metavar="[SESSION]", help="All sessions where none is named.")
    ] = None,
    property_: Annotated[list[str] | None, typer.Option("--property", help="Only this property; repeatable.")] = None,
    only_open: Annotated[bool, typer.Option("--open", help="Only those that are open.")] = False,
    origin: OriginOption = None,
    url: UrlOption = _DEFAULT_URL,
    token: TokenOption = None,
    as_json: AsJson = False,
) -> None:
    """Print episodes: violations of a property that follow each other closely, as one."""
    from oracle_server.cli.client import Client
    from oracle_server.cli.episodes import show_episodes

    if session is not None and origin is not None:
        raise typer.BadParameter("a session is of one robot already: name the session or --origin")
    show_episodes(Client(url, token), session, property_ or [], origin, only_open=only_open, as_json=as_json)


def record(
    session: Annotated[str, typer.Argument(metavar="SESSION")],
    out: Annotated[Path, typer.Option("--output", "-o", help="The file to write, .mcap or .jsonl.")],
    url: UrlOption = _DEFAULT_URL,
    token: TokenOption = None,
) -> None:
    """Store a session for `replay`; a file named .mcap is for Foxglove, too."""
    from oracle_server.cli.client import Client
    from oracle_server.cli.record import record_session

    record_session(Client(url, token), session, out)


def put(
    specs: SpecFiles,
    url: UrlOption = _DEFAULT_URL,
    token: TokenOption = None,
) -> None:
    """Check specs as the server does, and store them there; open sessions keep theirs. Needs the scope admin."""
    from oracle_server.cli.client import Client
    from oracle_server.cli.putting import put_specs

    put_specs(Client(url, token), specs)


def close(
    session: Annotated[str, typer.Argument(metavar="SESSION")],
    url: UrlOption = _DEFAULT_URL,
    token: TokenOption = None,
    as_json: AsJson = False,
) -> None:
    """Judge what a session holds, and close it; its history stays, and can be read."""
    from oracle_server.cli.client import Client
    from oracle_server.cli.tables import show_closed

    show_closed(Client(url, token), session, as_json=as_json)
