"""The commands for spec files: `init`, `check`, `schema`, `import` and `streams`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from oracle_server.cli.findings import FindingsFormat, as_annotation, as_json, as_sarif
from oracle_server.cli.options import SpecFiles, TypeFolders, named
from oracle_server.core.errors import Finding, SpecError

if TYPE_CHECKING:
    from oracle_server.core.derived.definition import Definition
    from oracle_server.core.spec import Property

_ROS: dict[str, Literal[1, 2]] = {"1": 1, "2": 2}


class RosVersion(StrEnum):
    """A version of ROS."""

    ONE = "1"
    TWO = "2"


def init(
    folder: Annotated[
        Path, typer.Argument(parser=named, metavar="FOLDER", help="A new folder; its name is the spec's.")
    ],
    examples: Annotated[
        bool, typer.Option("--examples", help="Write the examples and specs of the documentation instead.")
    ] = False,
) -> None:
    """Begin a spec: write a commented one, a recording with faults, and what to do with them."""
    from oracle_server.cli.init import begin, begin_examples

    for path in (begin_examples if examples else begin)(folder):
        typer.echo(str(path))


def check(
    specs: SpecFiles,
    ros: Annotated[RosVersion | None, typer.Option(help="Warn of what this version of ROS can't do.")] = None,
    ros_graph: Annotated[Path | None, typer.Option(help="A dump of the ROS graph, to find deadlocks.")] = None,
    types: TypeFolders = None,
    strict: Annotated[bool, typer.Option("--strict", help="Refuse specs with warnings, too.")] = False,
    json_lines: Annotated[bool, typer.Option("--json", help="The same as --format json.")] = False,
    form: Annotated[
        FindingsFormat, typer.Option("--format", help="The format of what is found.")
    ] = FindingsFormat.TEXT,
    formulas: Annotated[bool, typer.Option("--formulas", help="Print formulas with all names written out.")] = False,
    mermaid: Annotated[bool, typer.Option("--mermaid", help="Print machines as diagrams of mermaid.")] = False,
) -> None:
    """Validate specs: schema, types, expressions, formulas, ordering hazards."""
    from oracle_server.rostypes.known import Types
    from oracle_server.specfiles.load import load_spec
    from oracle_server.specfiles.rosgraph import load_graph

    graph = load_graph(ros_graph) if ros_graph else None
    known = Types(types or ())
    ids: dict[str, Path] = {}
    form = FindingsFormat.JSON if json_lines else form
    plain = form in (FindingsFormat.TEXT, FindingsFormat.GITHUB)
    sound = refused = 0
    counts = Counter[str]()
    all_findings: list[Finding] = []
    for path in specs:
        findings: tuple[Finding, ...]
        try:
            loaded = load_spec(path, _ROS[ros] if ros else None, graph, known)
        except SpecError as error:
            findings = error.findings
        else:
            findings = (*loaded.warnings, *_doubled(loaded.spec.id, path, ids))
            _print_formulas(path, loaded.spec.properties if formulas else (), form)
            _print_machines(path, loaded.spec.derive if mermaid else (), form)
        _print(findings, form)
        all_findings += findings
        counts.update(finding.severity for finding in findings)
        wrong = any(finding.severity == "error" for finding in findings)
        if wrong or (strict and findings):
            refused += 1
            if not wrong and plain:
                typer.echo(f"{path}: refused because of --strict: {_count(len(findings), 'warning')}", err=True)
            continue
        sound += 1
        if plain:
            typer.echo(f"{path}: sound")
    if form is FindingsFormat.SARIF:
        typer.echo(as_sarif(all_findings))
    if counts and plain:
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


def _print(findings: Iterable[Finding], form: FindingsFormat) -> None:
    """Print what is found in one file; a SARIF document is printed at the end."""
    for finding in findings:
        match form:
            case FindingsFormat.TEXT:
                typer.echo(str(finding), err=True)
            case FindingsFormat.JSON:
                typer.echo(as_json(finding))
            case FindingsFormat.GITHUB:
                typer.echo(as_annotation(finding))
            case FindingsFormat.SARIF:
                pass


def _print_formulas(path: Path, properties: Iterable[Property], form: FindingsFormat) -> None:
    """Print each property's formula, of those that are formulas of ours, where the format has room for them."""
    import json

    from oracle_server.core.derived.words import described
    from oracle_server.specfiles.lowered import lowered

    properties = list(properties)
    measures = {prop.id: prop.measures for prop in properties}
    for told in lowered(properties):
        if form is FindingsFormat.JSON:
            typer.echo(json.dumps({"file": str(path), **told}, ensure_ascii=False))
        elif form is FindingsFormat.TEXT:
            typer.echo(f"{path}: {told['property']}: {told['formula']}")
            for measure in measures[told["property"]]:
                typer.echo(f"{path}: {told['property']}: {measure.name}: {described(measure)}")


def _print_machines(path: Path, derived: Iterable[Definition], form: FindingsFormat) -> None:
    """Print each machine as a diagram, where the format has room for them."""
    import json

    from oracle_server.core.machines.drawing import mermaid

    for definition in derived:
        if definition.table is None:
            continue
        lines = list(mermaid(definition))
        if form is FindingsFormat.JSON:
            found = {"file": str(path), "machine": definition.name, "mermaid": "\n".join(lines)}
            typer.echo(json.dumps(found, ensure_ascii=False))
        elif form is FindingsFormat.TEXT:
            typer.echo("\n".join([f"%% {path}: {definition.name}", *lines]))


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def schema() -> None:
    """Print the JSON Schema of spec files, for editors."""
    import json

    from oracle_server.specfiles.schema import spec_schema

    typer.echo(json.dumps(spec_schema(), indent=2))


def import_(
    config: Annotated[
        Path | None, typer.Argument(metavar="[CONFIG]", help="A configuration of ROSMonitoring (.yaml).")
    ] = None,
    fret: Annotated[Path | None, typer.Option(help="An export of FRET's requirements (.json), in its place.")] = None,
    hpl: Annotated[Path | None, typer.Option(help="A file of properties in HPL, of HAROS, in its place.")] = None,
    variables: Annotated[
        Path | None, typer.Option(help="With --fret: Ogma's variable file (.json), which says the topics.")
    ] = None,
    diagram: Annotated[
        Path | None, typer.Option(help="A state diagram of mermaid or DOT, in place of a CONFIG.")
    ] = None,
    properties: Annotated[list[Path] | None, typer.Option(help="A property module; repeatable.")] = None,
    out: Annotated[Path | None, typer.Option("--output", "-o", help="The spec to write; default: print it.")] = None,
    types: TypeFolders = None,
    strict: Annotated[
        bool, typer.Option("--strict", help="Exit with 1 where something is left to be written, or warned of.")
    ] = False,
) -> None:
    """Write a spec from ROSMonitoring's configuration, FRET's requirements, properties in HPL, or a state diagram."""
    from oracle_server.process.progress import progress
    from oracle_server.rostypes.known import Types
    from oracle_server.specfiles.diagrams.write import import_diagram
    from oracle_server.specfiles.fret.write import import_fret
    from oracle_server.specfiles.hpl.write import import_hpl
    from oracle_server.specfiles.rosmonitoring.write import import_config

    given = [source for source in (config, fret, hpl, diagram) if source]
    if len(given) != 1:
        message = "one of these is wanted: a CONFIG, `--fret reqs.json`, `--hpl robot.hpl`, or `--diagram modes.mmd`"
        raise typer.BadParameter(message)
    if (properties and not config) or (variables and not fret):
        raise typer.BadParameter("`--variables` goes with `--fret`, and `--properties` with a CONFIG")
    known = Types(types or ())
    with progress(f"reading {given[0].name}"):
        if diagram:
            imported = import_diagram(diagram, out, known)
        elif fret:
            imported = import_fret(fret, variables, out, known)
        elif hpl:
            imported = import_hpl(hpl, out, known)
        else:
            imported = import_config(given[0], properties or [], out, known)
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

    if not spec.exists():
        raise typer.BadParameter(
            f"there is no file '{spec}': it takes a spec file, such as specs/battery_uav.yaml. What is observed "
            "in a session stands on its page, and in `GET /api/v1/sessions/ID`; `oracle-server specs` lists a server's",
            param_hint="SPEC",
        )
    ready = plan(load_spec(spec, types=Types(types or ())).spec)
    frames = [stream_frame(ready, key) for key in ready.streams]
    document = {"spec": ready.spec.id, "spec_digest": ready.spec.digest, "streams": frames}
    typer.echo(json.dumps(document, indent=2))
