"""The commands that run a server: `serve`, and in the background `start`, `stop` and `status`."""

from __future__ import annotations

import os
from collections.abc import Callable
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any

import typer

from oracle_server.cli.options import AsJson, DataDir, TypeFolders, named

Within = Annotated[float, typer.Option(min=0.1, help="Seconds to wait.")]
_OF_A_SERVER: dict[str, Any] = {
    "specs": Annotated[
        Path | None,
        typer.Option("--specs", parser=named, metavar="<path>", help="The folder of the specs; default ./specs."),
    ],
    "types": TypeFolders,
    "data_dir": DataDir,
    "host": Annotated[str | None, typer.Option(help="The address to bind; default 127.0.0.1.")],
    "port": Annotated[int | None, typer.Option(min=0, max=65535, help="The port; default 8642.")],
    "unix": Annotated[
        Path | None, typer.Option("--unix", parser=named, metavar="PATH", help="Listen at a UNIX socket, too.")
    ],
    "legacy": Annotated[str | None, typer.Option(metavar="SPEC", help="The spec of ROSMonitoring's monitors.")],
    "legacy_finals": Annotated[
        bool | None, typer.Option("--legacy-finals", help="Tell them final verdicts, at which those that only log end.")
    ],
    "forward": Annotated[
        str | None, typer.Option(metavar="URL", help="Forward the history to a centre's, postgresql://….")
    ],
    "origin": Annotated[
        str | None, typer.Option(metavar="NAME", help="This robot's name at the centre; default its host's name.")
    ],
    "tls_cert": Annotated[
        Path | None, typer.Option(parser=named, metavar="<path>", help="The server's certificate (PEM), for TLS.")
    ],
    "tls_key": Annotated[
        Path | None, typer.Option(parser=named, metavar="<path>", help="The certificate's key (PEM).")
    ],
    "tls_client_ca": Annotated[
        Path | None,
        typer.Option(
            parser=named, metavar="<path>", help="Clients must present a certificate of this authority (PEM)."
        ),
    ],
    "insecure": Annotated[
        bool | None, typer.Option("--insecure", help="Allow a bind beyond loopback without tokens or TLS.")
    ],
    "foxglove": Annotated[
        int | None, typer.Option(metavar="PORT", min=0, max=65535, help="Show sessions live to Foxglove at this port.")
    ],
    "foxglove_insecure": Annotated[
        bool | None, typer.Option("--foxglove-insecure", help="Do so beyond loopback though Foxglove sends no token.")
    ],
}
"""The settings that a server takes on its command line, in the foreground or in the background."""

_Command = Callable[..., None]


def _takes_settings(command: _Command) -> _Command:
    """Add the options `_OF_A_SERVER` to a command; it receives them as keyword arguments, None where not given."""
    own = [p for p in signature(command, eval_str=True).parameters.values() if p.kind is not Parameter.VAR_KEYWORD]
    settings = [
        Parameter(name, Parameter.KEYWORD_ONLY, default=None, annotation=kind) for name, kind in _OF_A_SERVER.items()
    ]
    command.__signature__ = Signature([*own, *settings])  # type: ignore[attr-defined]
    return command


def _as_texts(settings: dict[str, Any]) -> dict[str, Any]:
    """The settings with a repeated option as the one text that the environment would have."""
    folders = settings["types"]
    return settings | {"types": os.pathsep.join(str(folder) for folder in folders) if folders else None}


@_takes_settings
def serve(
    read_only: Annotated[
        bool | None, typer.Option("--read-only", help="Only read a history that another process writes.")
    ] = None,
    **settings: Any,
) -> None:
    """Run the server in the foreground, until SIGTERM, SIGINT or SIGHUP."""
    from oracle_server.process.settings import load_settings
    from oracle_server.server import serve as run

    run(load_settings(read_only=read_only, **_as_texts(settings)))


@_takes_settings
def start(within: Within = 300.0, **settings: Any) -> None:
    """Run the server in the background; return once it accepts work."""
    from oracle_server.process.daemon import start as run
    from oracle_server.process.settings import load_settings

    run(load_settings(**_as_texts(settings)), within)


def stop(data_dir: DataDir = None, within: Within = 60.0) -> None:
    """Stop the server of a data directory, after it has judged and committed all held events."""
    from oracle_server.process.daemon import stop as run
    from oracle_server.process.settings import load_settings

    run(load_settings(data_dir=data_dir).data_dir, within)


def status(
    data_dir: DataDir = None,
    ready: Annotated[bool, typer.Option("--ready", help="End with 3, too, where it is not ready.")] = False,
    as_json: AsJson = False,
) -> None:
    """Show the state of the server of a data directory; the exit status is 3 where none runs."""
    from oracle_server.process.daemon import status as run
    from oracle_server.process.settings import load_settings

    raise typer.Exit(run(load_settings(data_dir=data_dir).data_dir, as_json=as_json, ready=ready))
