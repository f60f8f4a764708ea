"""The command `token`: adds, removes and lists the tokens of a server."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from oracle_server.cli.options import AsJson, DataDir


class Scope(StrEnum):
    """What a token permits."""

    SUBMIT = "submit"
    READ = "read"
    ADMIN = "admin"


def add(
    name: Annotated[str, typer.Argument(metavar="NAME", help="The token's name.")],
    scope: Annotated[list[Scope], typer.Option(help="What it permits; repeatable.")],
    spec: Annotated[list[str] | None, typer.Option(help="Valid for this spec only; repeatable.")] = None,
    session: Annotated[list[str] | None, typer.Option(help="Valid for this session only; repeatable.")] = None,
    data_dir: DataDir = None,
) -> None:
    """Create a token and print it; it is not shown again. A running server accepts it at once."""
    from oracle_server.edge import tokens
    from oracle_server.process.pidfile import running
    from oracle_server.process.settings import load_settings

    settings = load_settings(data_dir=data_dir)
    typer.echo(tokens.add(settings.token_file, name, [s.value for s in scope], spec, session))
    if settings.tokens is None and running(settings.data_dir) is None:
        typer.echo(
            f"oracle-server: kept in {settings.token_file}, for a server with this data directory, and none runs now; "
            "one with another directory asks for no token: name that by --data-dir",
            err=True,
        )


def remove(name: Annotated[str, typer.Argument(metavar="NAME")], data_dir: DataDir = None) -> None:
    """Revoke a token."""
    from oracle_server.edge import tokens
    from oracle_server.process.settings import load_settings

    tokens.remove(load_settings(data_dir=data_dir).token_file, name)


def list_(data_dir: DataDir = None, as_json: AsJson = False) -> None:
    """List the tokens with their scopes, specs and sessions."""
    from oracle_server.cli.tables import show_tokens
    from oracle_server.edge import tokens
    from oracle_server.process.settings import load_settings

    show_tokens(tokens.listed(load_settings(data_dir=data_dir).token_file), as_json=as_json)
