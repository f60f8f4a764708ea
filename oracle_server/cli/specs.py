"""The commands for spec files: `check`, `import` and `streams`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

import typer

from oracle_server.cli.options import SpecFiles
from oracle_server.core.errors import SpecError

_ROS: dict[str, Literal[1, 2]] = {"1": 1, "2": 2}


class RosVersion(StrEnum):
    """A version of ROS."""

    ONE = "1"
    TWO = "2"


def check(
    specs: SpecFiles,
    ros: Annotated[RosVersion | None, typer.Option(help="Warn of what this version of ROS can't do.")] = None,
    ros_graph: Annotated[Path | None, typer.Option(help="A dump of the ROS graph, to find deadlocks.")] = None,
) -> None:
    """Validate specs: schema, expressions, formulas, ordering hazards."""
    from oracle_server.specfiles.load import load_spec
    from oracle_server.specfiles.rosgraph import load_graph

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


def import_(
    config: Annotated[Path, typer.Argument(metavar="CONFIG", help="A configuration of ROSMonitoring (.yaml).")],
    properties: Annotated[list[Path] | None, typer.Option(help="A property module; repeatable.")] = None,
    out: Annotated[Path | None, typer.Option("--output", "-o", help="The spec to write; default: print it.")] = None,
) -> None:
    """Write a spec from ROSMonitoring's configuration and property modules, which are read and never run."""
    from oracle_server.specfiles.rosmonitoring.write import import_config

    import_config(config, properties or [], out)


def streams(spec: Annotated[Path, typer.Argument(metavar="SPEC", help="A spec file.")]) -> None:
    """Print the streams that an adapter observes for a spec; its `--log` reads them where there is no server."""
    import json

    from oracle_server.core.plan import plan
    from oracle_server.sessions.greeting import stream_frame
    from oracle_server.specfiles.load import load_spec

    ready = plan(load_spec(spec).spec)
    frames = [stream_frame(ready, key) for key in ready.streams]
    document = {"spec": ready.spec.id, "spec_digest": ready.spec.digest, "streams": frames}
    typer.echo(json.dumps(document, indent=2))
