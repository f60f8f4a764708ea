"""The commands for spec files: `check`, `import` and `streams`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from oracle_server.cli.options import SpecFiles, TypeFolders
from oracle_server.core.errors import Finding, SpecError

if TYPE_CHECKING:
    from oracle_server.core.spec import Property

_ROS: dict[str, Literal[1, 2]] = {"1": 1, "2": 2}


class RosVersion(StrEnum):
    """A version of ROS."""

    ONE = "1"
    TWO = "2"


def check(
    specs: SpecFiles,
    ros: Annotated[RosVersion | None, typer.Option(help="Warn of what this version of ROS can't do.")] = None,
    ros_graph: Annotated[Path | None, typer.Option(help="A dump of the ROS graph, to find deadlocks.")] = None,
    types: TypeFolders = None,
    strict: Annotated[bool, typer.Option("--strict", help="Refuse specs with warnings, too.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print what is found as JSON Lines.")] = False,
    formulas: Annotated[bool, typer.Option("--formulas", help="Print formulas with all names written out.")] = False,
) -> None:
    """Validate specs: schema, types, expressions, formulas, ordering hazards."""
    from oracle_server.rostypes.known import Types
    from oracle_server.specfiles.load import load_spec
    from oracle_server.specfiles.rosgraph import load_graph

    graph = load_graph(ros_graph) if ros_graph else None
    known = Types(types or ())
    ids: dict[str, Path] = {}
    sound = refused = 0
    counts = Counter[str]()
    for path in specs:
        findings: tuple[Finding, ...]
        try:
            loaded = load_spec(path, _ROS[ros] if ros else None, graph, known)
        except SpecError as error:
            findings = error.findings
        else:
            findings = (*loaded.warnings, *_doubled(loaded.spec.id, path, ids))
            _print_formulas(path, loaded.spec.properties if formulas else (), as_json=as_json)
        for finding in findings:
            typer.echo(_json(finding) if as_json else str(finding), err=not as_json)
        counts.update(finding.severity for finding in findings)
        wrong = any(finding.severity == "error" for finding in findings)
        if wrong or (strict and findings):
            refused += 1
            if not wrong and not as_json:
                typer.echo(f"{path}: refused because of --strict: {_count(len(findings), 'warning')}", err=True)
            continue
        sound += 1
        if not as_json:
            typer.echo(f"{path}: sound")
    if counts and not as_json:
        told = [_count(counts[severity], severity) for severity in ("error", "warning") if counts[severity]]
        typer.echo(", ".join([f"{_count(sound, 'spec')} sound", *told]))
    if refused:
        raise typer.Exit(1)


def _doubled(spec_id: str, path: Path, ids: dict[str, Path]) -> list[Finding]:
    """A warning where another file has the same id, of which a server takes the first; `ids` has those of before."""
    first = ids.setdefault(spec_id, path)
    if first.resolve() == path.resolve():
        return []
    message = f"the id '{spec_id}' is that of {first} already: a server takes the first of them"
    return [Finding(str(path), 1, 1, message, "warning")]


def _print_formulas(path: Path, properties: Iterable[Property], *, as_json: bool) -> None:
    """Print each property's formula, of those that are formulas of ours."""
    import json

    from oracle_server.core.formula.render import render

    for prop in properties:
        if prop.external or prop.numeric:
            continue
        text = render(prop.formula, prop.time)
        told = {"file": str(path), "property": prop.id, "time": prop.time, "formula": text}
        typer.echo(json.dumps(told, ensure_ascii=False) if as_json else f"{path}: {prop.id}: {text}")


def _json(finding: Finding) -> str:
    import json
    from dataclasses import asdict

    return json.dumps(asdict(finding), ensure_ascii=False)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def import_(
    config: Annotated[Path, typer.Argument(metavar="CONFIG", help="A configuration of ROSMonitoring (.yaml).")],
    properties: Annotated[list[Path] | None, typer.Option(help="A property module; repeatable.")] = None,
    out: Annotated[Path | None, typer.Option("--output", "-o", help="The spec to write; default: print it.")] = None,
    types: TypeFolders = None,
    strict: Annotated[
        bool, typer.Option("--strict", help="Exit with 1 where something is left to be written, or warned of.")
    ] = False,
) -> None:
    """Write a spec from ROSMonitoring's configuration and property modules, which are read and never run."""
    from oracle_server.process.progress import progress
    from oracle_server.rostypes.known import Types
    from oracle_server.specfiles.rosmonitoring.write import import_config

    with progress(f"reading {config.name}"):
        imported = import_config(config, properties or [], out, Types(types or ()))
    for finding in imported.findings:
        typer.echo(str(finding), err=True)
    for line in imported.summary:
        typer.echo(f"{out or 'the spec'}: {line}", err=True)
    if imported.refused or not imported.judges or (strict and not imported.done):
        raise typer.Exit(1)


def streams(
    spec: Annotated[Path, typer.Argument(metavar="SPEC", help="A spec file.")], types: TypeFolders = None
) -> None:
    """Print the streams that an adapter observes for a spec; its `--log` reads them where there is no server."""
    import json

    from oracle_server.core.plan import plan
    from oracle_server.rostypes.known import Types
    from oracle_server.sessions.greeting import stream_frame
    from oracle_server.specfiles.load import load_spec

    ready = plan(load_spec(spec, types=Types(types or ())).spec)
    frames = [stream_frame(ready, key) for key in ready.streams]
    document = {"spec": ready.spec.id, "spec_digest": ready.spec.digest, "streams": frames}
    typer.echo(json.dumps(document, indent=2))
