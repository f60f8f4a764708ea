"""Loads spec files: YAML to a `Spec`; all errors are reported together, each with file, line and column."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from oracle_server.core.derived.definition import Definition
from oracle_server.core.errors import EngineError, Finding, FormulaError, SpecError, SpecProblem
from oracle_server.core.formula.ahead import WORDS, first_ahead
from oracle_server.core.formula.tree import Atom, Formula, walk
from oracle_server.core.hazards.dependencies import GraphNode
from oracle_server.core.hazards.inspection import inspect
from oracle_server.core.hazards.ros import Ros, ros_hazards
from oracle_server.core.spec import SILENT, External, Ordering, Property, Retention, Spec, StreamSpec
from oracle_server.core.stamps import Stamp
from oracle_server.engines.table import ENGINES
from oracle_server.rostypes.known import Types
from oracle_server.rostypes.streams import stream_types
from oracle_server.specfiles.actions import action_findings, action_problems, action_streams
from oracle_server.specfiles.defining import Definitions
from oracle_server.specfiles.derive import definitions
from oracle_server.specfiles.document import MAX_TEXT, Document, read_yaml
from oracle_server.specfiles.elsewhere import external_problems
from oracle_server.specfiles.machines import is_machine, is_read
from oracle_server.specfiles.model import ActionModel, HalfModel, PropertyModel, ServiceModel, SpecModel, TopicModel
from oracle_server.specfiles.sentences import ENGINES_OF_SENTENCES, SAYS, measured, measuring, read_said
from oracle_server.specfiles.texts import formula_finding, texts_findings
from oracle_server.specfiles.wording import model_findings

MOST = 1_000
"""Streams, and properties, that a spec may have."""
MOST_PAIRS = 500_000
"""Pairs of a stream and a part of a formula (an operator or a comparison) that a spec may have: each is looked at."""


@dataclass(frozen=True, slots=True)
class SpecFile:
    """A sound spec, the text that it was read from, and its warnings."""

    spec: Spec
    text: str
    warnings: tuple[Finding, ...]


def load_spec(
    path: Path, ros: Ros | None = None, graph: Sequence[GraphNode] | None = None, types: Types | None = None
) -> SpecFile:
    """Read and check a spec file, for a version of ROS and a graph if given. Raises `SpecError` with all findings.

    With `types`, the types of its streams are checked, and the fields that it reads of their messages.
    """
    try:
        with path.open("rb") as file:
            data = file.read(4 * MAX_TEXT + 1)
        text = data.decode()
    except OSError as error:
        raise SpecError([Finding(str(path), 1, 1, f"can't be read: {error.strerror}")]) from None
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise SpecError([Finding(str(path), line, 1, "not UTF-8 text")]) from None
    return parse_spec(text, str(path), ros, graph, types)


def parse_spec(
    text: str,
    file: str,
    ros: Ros | None = None,
    graph: Sequence[GraphNode] | None = None,
    types: Types | None = None,
    *,
    bounded: bool = True,
) -> SpecFile:
    """Read and check the text of a spec; `file` is its name in findings. Raises `SpecError` with all findings.

    Without `types` nothing is said of types and fields, as where a session is restored, whose spec was accepted.
    `bounded`: it may have no more than so many streams, properties and parts; those of old sessions may have more.
    """
    document = read_yaml(text, file)
    if document.value is None:
        raise SpecError([Finding(file, 1, 1, "the file is empty; a spec has `id`, `streams` and `properties`")])
    crowded = [_crowd(document, key) for key in ("streams", "properties") if _size(document.value, key) > MOST]
    if bounded and crowded:
        raise SpecError(crowded)
    try:
        model = SpecModel.model_validate(document.value)
    except ValidationError as error:
        raise SpecError(_sorted([*model_findings(document, error.errors()), *texts_findings(document)])) from None
    named = Definitions(document)
    findings = [*named.findings(), *action_findings(document, model.streams)]
    derived = definitions(document, model.derive, findings, named.names)
    signals = {each.name: each for each in derived}
    unread = {name for name, each in model.derive.items() if is_machine(each) and not is_read(signals.get(name))}
    properties = [
        None if (p.machine or "").strip() in unread else _property(document, i, p, named, signals, findings)
        for i, p in enumerate(model.properties)
    ]
    made = [p or _make(m, SILENT, "") for p, m in zip(properties, model.properties, strict=True)]
    derived += measured(document, derived, made, findings)
    spec = _spec(model, tuple(made), tuple(derived))
    formulas = [prop.formula for prop in spec.properties] + [f for d in spec.derive for f in d.formulas or [SILENT]]
    places = [i for i, stream in enumerate(model.streams) for _ in _streams(stream)]
    pairs = len(spec.streams) * sum(_parts(formula) for formula in formulas)
    if bounded and pairs > MOST_PAIRS:
        message = (
            f"the formulas have too many parts for {len(spec.streams)} streams: at most {MOST_PAIRS:,} pairs of a "
            f"stream and an operator or comparison, not {pairs:,}; write several specs"
        )
        raise SpecError(_sorted([*findings, Finding(file, *document.place(("properties",)), message)]))
    known, typed = stream_types(spec, types, ros) if types is not None else (None, [])
    typed = [replace(problem, kind="type") for problem in typed]
    problems = [
        *typed,
        *inspect(spec, graph, known),
        *_engines(spec),
        *_revising(spec, model),
        *(_on_ros(spec, ros, typed) if ros else ()),
        *named.clashes(spec),
        *named.numeric(spec),
        *named.unused(),
        *action_problems(model.streams, places),
    ]
    told = {(p.path, p.within) for p in problems if p.kind == "type" and p.within and p.severity == "error"}
    problems = [p for p in problems if p.kind == "type" or (p.path, p.within) not in told]
    if findings:  # what is doubtful may be so because of them
        problems = [p for p in problems if p.severity == "error"]
    elif any(p.severity == "error" for p in problems):
        problems = [p for p in problems if p.severity == "error" or p.path[-1] != "formula"]
    findings = _sorted(dict.fromkeys([*findings, *(_finding(document, p, spec, places, named) for p in problems)]))
    if any(f.severity == "error" for f in findings):
        raise SpecError(findings)
    return SpecFile(spec, text, tuple(findings))


def _sorted(findings: Iterable[Finding]) -> list[Finding]:
    return sorted(findings, key=lambda f: (f.line, f.column))


def _parts(formula: Formula) -> int:
    """How many operators and comparisons a formula has."""
    return sum(max(1, len(node.constraints)) if isinstance(node, Atom) else 1 for node in walk(formula))


def _size(value: Any, key: str) -> int:
    found = value.get(key) if isinstance(value, dict) else None
    return len(found) if isinstance(found, list) else 0


def _crowd(document: Document, key: str) -> Finding:
    message = f"there are {_size(document.value, key)} {key}; a spec has at most {MOST:,}: write several specs"
    return Finding(document.file, *document.place((key, MOST)), message)


_UNSAID = "the key 'formula' is missing, or `pattern`, `requirement` or `machine`: write what must hold, in quotes"
_SAID_TWICE = (
    "what must hold is said by one of `formula`, `pattern`, `requirement` and `machine`; give each a "
    "property of its own"
)
_ONLY_EXTERNAL = ("url", "timeout", "streams", "names")


def _property(
    document: Document,
    index: int,
    model: PropertyModel,
    definitions: Definitions,
    derived: Mapping[str, Definition],
    findings: list[Finding],
) -> Property | None:
    place: tuple[str | int, ...] = ("properties", index)
    external = model.engine == "external"
    if external:
        problems = list(external_problems(model))
    else:
        given = [key for key in _ONLY_EXTERNAL if key in model.model_fields_set]
        problems = [(key, f"`{key}` is for `engine: external`") for key in given]
    if problems:
        findings += [
            Finding(document.file, *document.place((*place, k)), f"property '{model.id}': {m}") for k, m in problems
        ]
        return None
    if external:
        assert model.url is not None  # noqa: S101 -- else there are problems
        received = None if model.streams is None else frozenset(model.streams)
        oracle = External(model.url, model.timeout, received, model.names == "bare")
        return _make(model, SILENT, f"the oracle at {model.url}", oracle)
    return _said(document, index, model, definitions, derived, findings)


def _said(
    document: Document,
    index: int,
    model: PropertyModel,
    definitions: Definitions,
    derived: Mapping[str, Definition],
    findings: list[Finding],
) -> Property | None:
    """A property that is said by a formula, or by what stands for one."""
    place: tuple[str | int, ...] = ("properties", index)
    says = [key for key in SAYS if getattr(model, key) is not None]
    if len(says) != 1:
        message = f"property '{model.id}': {_UNSAID if not says else _SAID_TWICE}"
        where = document.key_place((*place, says[1])) if says else document.place(place)
        findings.append(Finding(document.file, *where, message))
        return None
    key, text = says[0], str(getattr(model, says[0]))
    if key != "formula" and model.engine not in ENGINES_OF_SENTENCES:
        message = f"property '{model.id}': a {key} is judged by the project's own engine; leave `engine` out"
        findings.append(Finding(document.file, *document.place((*place, "engine")), message))
        return None
    time = model.time if "time" in model.model_fields_set else None
    try:
        meant = read_said(document, key, text, model.engine, time, definitions.names, model.id, derived)
    except EngineError as error:
        findings.append(Finding(document.file, *document.place((*place, "engine")), f"property '{model.id}': {error}"))
        return None
    except FormulaError as error:
        if not error.told:
            findings.append(formula_finding(document, index, model.id, error, definitions, key))
        return None
    made = _make(model, meant.formula, " ".join(text.split()))
    return replace(made, time=meant.time, says=key, measures=meant.measures, states=meant.states)


def _make(model: PropertyModel, formula: Formula, text: str, external: External | None = None) -> Property:
    return Property(
        id=model.id,
        formula=formula,
        text=text,
        description=model.description,
        time=model.time,
        time_given="time" in model.model_fields_set,
        guards=frozenset(model.guards),
        blame=model.blame,
        blame_given="blame" in model.model_fields_set,
        latch=model.latch,
        at_end=model.at_end,
        engine=model.engine,
        numeric=ENGINES[model.engine].numeric,
        external=external,
    )


def _spec(model: SpecModel, properties: tuple[Property, ...], derived: tuple[Definition, ...]) -> Spec:
    streams = tuple(stream for m in model.streams for stream in _streams(m))
    ordering = Ordering(**model.ordering.model_dump())
    retention = Retention(**model.retention.model_dump())
    meaning = model.model_dump(
        mode="json",
        warnings="none",
        exclude={
            "description": True,
            "retention": True,
            "episodes": True,
            "close": True,
            "properties": {"__all__": {"description"}},
        },
    )
    for prop in meaning["properties"]:
        if prop["at_end"] == "ignore":  # so that specs without it keep the digest that older versions gave them
            del prop["at_end"]
        for key in SAYS[1:]:
            if prop[key] is None:
                del prop[key]
    if not model.define:  # a spec without names is what it was before there were any
        del meaning["define"]
    if not derived:  # as in specs of versions that knew none
        del meaning["derive"]
    else:
        meaning["derive"] = list(meaning["derive"].items())  # in order
    digest = hashlib.sha256(json.dumps(meaning, sort_keys=True).encode()).hexdigest()
    gap = model.episodes.gap
    return Spec(
        model.id, streams, properties, ordering, model.description, digest, retention, model.close, derived, gap
    )


def _streams(model: TopicModel | ServiceModel | ActionModel) -> Iterator[StreamSpec]:
    common: dict[str, Any] = {
        "type": model.type,
        "latency": model.latency,
        "ordered": model.ordered,
        "causes": tuple(model.causes),
        "action": model.action,
        "on_unavailable": model.on_unavailable,
        "decide_within": model.decide_within,
        "on_deny": model.on_deny,
        "on_deny_given": "on_deny" in model.model_fields_set,
    }
    if isinstance(model, TopicModel):
        yield StreamSpec(model.topic, intercept=model.intercept, **_channel(model), **common)
    elif isinstance(model, ActionModel):
        yield from action_streams(model, common, _channel)
    else:
        common |= {"proxy": model.proxy or f"{model.service}_mon", "denied_response": model.denied_response}
        yield StreamSpec(model.service, "request", **_channel(model.request), **common)
        yield StreamSpec(model.service, "response", **_channel(model.response), **common)


def _channel(model: TopicModel | HalfModel) -> dict[str, Any]:
    where = model.stamp
    stamp = Stamp(where) if isinstance(where, str) else where and Stamp(where.field, where.unit, where.epoch)
    return {"stamp": stamp, "hold": frozenset(model.hold), "signals": model.signals, "each": model.each}


def _engines(spec: Spec) -> Iterator[SpecProblem]:
    for i, prop in enumerate(spec.properties):
        row = ENGINES[prop.engine]
        refusal = row.refuses(prop)
        if refusal is not None:
            yield SpecProblem(("properties", i, refusal.key), f"property '{prop.id}': {refusal.reason}")
        for message, within in row.doubts(prop):
            path = ("properties", i, "formula")
            yield SpecProblem(path, f"property '{prop.id}': {message}", within, severity="warning")
        if row.goes_back(prop):
            continue
        if spec.ordering.late == "revise":
            yield SpecProblem(
                ("properties", i, "engine"),
                f"property '{prop.id}': `late: revise` judges again what came after a late event, and `engine: "
                f"{prop.engine}` can't go back; `native` can, or write `late: judge` under `ordering`",
            )
        native = f"needs an engine that can take steps back, and `engine: {prop.engine}` can't; `native` can"
        if prop.blame == "caused":
            yield SpecProblem(("properties", i, "blame"), f"`blame: caused` {native}")
        for j, stream in enumerate(spec.streams):
            if stream.on_deny == "undo" and stream.leads:
                yield SpecProblem(("streams", j, "on_deny"), f"`on_deny: undo` {native} (property '{prop.id}')")


def _revising(spec: Spec, model: SpecModel) -> Iterator[SpecProblem]:
    """What keeps `late: revise` from being what it says."""
    if spec.ordering.late != "revise":
        if "horizon" in model.ordering.model_fields_set:
            yield SpecProblem(
                ("ordering", "horizon"),
                "`horizon` is that of `late: revise`; write that too, or leave `horizon` out",
            )
        return
    for i, prop in enumerate(spec.properties):
        first = None if prop.external or prop.numeric else first_ahead(prop.formula)
        if first is not None:
            message = (
                f"property '{prop.id}': `late: revise` can't go back over what `{WORDS[type(first)]}` waits for; write "
                "`late: judge`, or a formula that looks back, as in `{done} -> once[:60] {goal}`"
            )
            yield SpecProblem(("properties", i, "formula"), message, within=first.at)
    if spec.ordering.by != "publication":
        yield SpecProblem(
            ("ordering", "late"),
            f"`late: revise` puts right the order of publication alone, and `by` is {spec.ordering.by}; leave `by` "
            "out, or write `late: judge`",
        )
    elif not any(stream.ordered for stream in spec.streams):
        yield SpecProblem(
            ("ordering", "late"), "no stream is ordered, so that nothing comes late; leave out `late: revise`"
        )


def _on_ros(spec: Spec, ros: Ros, typed: Iterable[SpecProblem]) -> Iterator[SpecProblem]:
    """What would not work on a version of ROS; nothing is said of streams whose types are not there at all."""
    mistaken = {problem.path[:2] for problem in typed if problem.severity == "error" and problem.path[2:] == ("type",)}
    return (problem for problem in ros_hazards(spec, ros) if problem.path[:2] not in mistaken)


def _finding(
    document: Document, problem: SpecProblem, spec: Spec, places: Sequence[int], definitions: Definitions
) -> Finding:
    path, message = _in_file(problem.path, spec, places), problem.message
    if path[0] == "derive":
        path = measuring(spec, path)
    if path[0] == "properties" and path[-1] == "formula":  # it may have been put together from a sentence
        key = spec.properties[int(path[1])].says
        path, message = (*path[:-1], key), re.sub("^formula of", f"{key} of", message)
    place = (
        document.key_place(path)
        if path[0] == "define" or path[2:3] == ("states",)
        else document.place(path, problem.within)
    )
    first = definitions.where(path, problem.within)
    if problem.first is not None:
        line, _ = document.place(_in_file(problem.first, spec, places))
        first += f"; the first is at {document.file}:{line}"
    return Finding(document.file, *place, message + first, problem.severity, problem.kind)


def _in_file(path: tuple[str | int, ...], spec: Spec, places: Sequence[int]) -> tuple[str | int, ...]:
    """The path in the file of a path in the spec, where each service is two streams; `places` are the streams' own."""
    if len(path) < 2 or path[0] != "streams" or not isinstance(path[1], int):
        return path
    stream = spec.streams[path[1]]
    own = not stream.traits.sole and path[2:3] and path[2] in ("stamp", "hold", "signals", "ordered")
    return ("streams", places[path[1]], *((stream.kind,) if own else ()), *path[2:])
