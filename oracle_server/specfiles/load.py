"""Loads spec files: YAML to a `Spec`; all errors are reported together, each with file, line and column."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from pydantic import ValidationError

from oracle_server.core.dependencies import GraphNode
from oracle_server.core.errors import EngineError, Finding, FormulaError, SpecError, SpecProblem
from oracle_server.core.formula.tree import Formula
from oracle_server.core.hazards import inspect
from oracle_server.core.kinds import GROUPS
from oracle_server.core.ros import Ros, ros_hazards
from oracle_server.core.spec import SILENT, External, Ordering, Property, Retention, Spec, StreamSpec
from oracle_server.engines.table import ENGINES
from oracle_server.specfiles.document import MAX_TEXT, Document, read_yaml
from oracle_server.specfiles.model import ChannelModel, PropertyModel, ServiceModel, SpecModel, TopicModel


@dataclass(frozen=True, slots=True)
class SpecFile:
    """A sound spec, the text that it was read from, and its warnings."""

    spec: Spec
    text: str
    warnings: tuple[Finding, ...]


def load_spec(path: Path, ros: Ros | None = None, graph: Sequence[GraphNode] | None = None) -> SpecFile:
    """Read and check a spec file, for a version of ROS and a graph if given. Raises `SpecError` with all findings."""
    try:
        with path.open("rb") as file:
            data = file.read(4 * MAX_TEXT + 1)
        text = data.decode()
    except OSError as error:
        raise SpecError([Finding(str(path), 1, 1, f"can't be read: {error.strerror}")]) from None
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise SpecError([Finding(str(path), line, 1, "not UTF-8 text")]) from None
    return parse_spec(text, str(path), ros, graph)


def parse_spec(text: str, file: str, ros: Ros | None = None, graph: Sequence[GraphNode] | None = None) -> SpecFile:
    """Read and check the text of a spec; `file` is its name in findings. Raises `SpecError` with all findings."""
    document = read_yaml(text, file)
    try:
        model = SpecModel.model_validate(document.value if document.value is not None else {})
    except ValidationError as error:
        found = [_model_finding(document, problem) for problem in error.errors()]
        raise SpecError(sorted(found, key=lambda f: (f.line, f.column))) from None
    findings: list[Finding] = []
    properties = [_property(document, i, p, findings) for i, p in enumerate(model.properties)]
    if findings:
        raise SpecError(findings)
    spec = _spec(model, tuple(p for p in properties if p is not None))
    problems = [*inspect(spec, graph), *_engines(spec), *(ros_hazards(spec, ros) if ros else ())]
    findings = sorted((_finding(document, p, spec) for p in problems), key=lambda f: (f.line, f.column))
    if any(f.severity == "error" for f in findings):
        raise SpecError(findings)
    return SpecFile(spec, text, tuple(findings))


_ONLY_EXTERNAL = ("url", "timeout", "streams", "names")


def _property(document: Document, index: int, model: PropertyModel, findings: list[Finding]) -> Property | None:
    place: tuple[str | int, ...] = ("properties", index)
    external = model.engine == "external"
    if external:
        problems = list(_external_problems(model))
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
    if model.formula is None:
        findings.append(Finding(document.file, *document.place(place), "the key 'formula' is missing"))
        return None
    try:
        formula = ENGINES[model.engine].read(model.formula, model.time)
    except EngineError as error:
        findings.append(Finding(document.file, *document.place((*place, "engine")), f"property '{model.id}': {error}"))
        return None
    except FormulaError as error:
        at = document.place((*place, "formula"), (error.line, error.column))
        findings.append(Finding(document.file, *at, f"formula of '{model.id}': {error.message}"))
        return None
    return _make(model, formula, " ".join(model.formula.split()))


def _external_problems(model: PropertyModel) -> Iterator[tuple[str, str]]:
    """The problems of a property that an external oracle judges: the key, and why."""
    if model.url is None:
        yield "engine", "`engine: external` needs the oracle's address, `url: ws://host:port`"
    else:
        reason = _unusable(model.url)
        if reason:
            yield "url", f"the address {model.url} {reason}"
    if model.formula is not None:
        yield "formula", "the oracle at `url` has a property of its own; leave `formula` out"
    if model.time != "steps":
        yield "time", "the oracle at `url` has a time of its own; leave `time` out"


def _unusable(url: str) -> str | None:
    """Why a URL can't be the address of an oracle, None where it can."""
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError as error:
        return f"can't be read: {error}"
    if not parts.hostname or re.search(r"[\s\x00-\x1f]", url):
        return "names no host"
    if port == 0:
        return "has port 0, which nothing listens on"
    if parts.username is not None or parts.password is not None:
        return "contains a name or password; specs can be read by everyone who may read verdicts"
    return "has a fragment after #, which is not sent to a server" if parts.fragment else None


def _make(model: PropertyModel, formula: Formula, text: str, external: External | None = None) -> Property:
    return Property(
        id=model.id,
        formula=formula,
        text=text,
        description=model.description,
        time=model.time,
        guards=frozenset(model.guards),
        blame=model.blame,
        latch=model.latch,
        engine=model.engine,
        numeric=ENGINES[model.engine].numeric,
        external=external,
    )


def _spec(model: SpecModel, properties: tuple[Property, ...]) -> Spec:
    streams = tuple(stream for m in model.streams for stream in _streams(m))
    ordering = Ordering(**model.ordering.model_dump())
    retention = Retention(**model.retention.model_dump())
    meaning = model.model_dump(
        mode="json",
        warnings="none",
        exclude={"description": True, "retention": True, "properties": {"__all__": {"description"}}},
    )
    digest = hashlib.sha256(json.dumps(meaning, sort_keys=True).encode()).hexdigest()
    return Spec(model.id, streams, properties, ordering, model.description, digest, retention)


def _streams(model: TopicModel | ServiceModel) -> Iterator[StreamSpec]:
    common: dict[str, Any] = {
        "type": model.type,
        "latency": model.latency,
        "ordered": model.ordered,
        "causes": tuple(model.causes),
        "action": model.action,
        "on_unavailable": model.on_unavailable,
        "decide_within": model.decide_within,
        "on_deny": model.on_deny,
    }
    if isinstance(model, TopicModel):
        yield StreamSpec(model.topic, intercept=model.intercept, **_channel(model), **common)
        return
    common |= {"proxy": model.proxy or f"{model.service}_mon", "denied_response": model.denied_response}
    yield StreamSpec(model.service, "request", **_channel(model.request), **common)
    yield StreamSpec(model.service, "response", **_channel(model.response), **common)


def _channel(model: ChannelModel) -> dict[str, Any]:
    return {"stamp": model.stamp, "hold": frozenset(model.hold), "signals": model.signals}


def _engines(spec: Spec) -> Iterator[SpecProblem]:
    for i, prop in enumerate(spec.properties):
        row = ENGINES[prop.engine]
        refusal = row.refuses(prop)
        if refusal is not None:
            yield SpecProblem(("properties", i, refusal.key), f"property '{prop.id}': {refusal.reason}")
        if row.goes_back(prop):
            continue
        native = f"needs an engine that can take steps back, and `engine: {prop.engine}` can't; `native` can"
        if prop.blame == "caused":
            yield SpecProblem(("properties", i, "blame"), f"`blame: caused` {native}")
        for j, stream in enumerate(spec.streams):
            if stream.on_deny == "undo" and stream.traits.leads:
                yield SpecProblem(("streams", j, "on_deny"), f"`on_deny: undo` {native} (property '{prop.id}')")


def _finding(document: Document, problem: SpecProblem, spec: Spec) -> Finding:
    place = document.place(_in_file(problem.path, spec), problem.within)
    return Finding(document.file, *place, problem.message, problem.severity)


def _in_file(path: tuple[str | int, ...], spec: Spec) -> tuple[str | int, ...]:
    """The path in the file of a path in the spec, where each service is two streams."""
    if len(path) < 2 or path[0] != "streams" or not isinstance(path[1], int):
        return path
    stream = spec.streams[path[1]]
    index = sum(s.traits.leads for s in spec.streams[: path[1] + 1]) - 1
    own = not stream.traits.sole and path[2:3] and path[2] in ("stamp", "hold", "signals")
    return ("streams", index, *((stream.kind,) if own else ()), *path[2:])


def _model_finding(document: Document, problem: Any) -> Finding:
    path = _without_tags(problem["loc"])
    if "[key]" in problem["loc"]:
        name = ".".join(str(part) for part in path[:-1])
        return Finding(document.file, *document.key_place(path), f"{name}: {_short(path[-1])} can't be a name here")
    name = ".".join(str(part) for part in path) or "the file"
    match problem["type"]:
        case "extra_forbidden":
            return Finding(document.file, *document.key_place(path), f"unknown key '{path[-1]}'")
        case "missing":
            return Finding(document.file, *document.place(path[:-1]), f"the key '{path[-1]}' is missing")
        case "value_error":
            message = str(problem["ctx"]["error"])
        case "literal_error":
            message = f"expected {problem['ctx']['expected']}, found {_short(problem['input'])}"
        case "string_pattern_mismatch":
            message = f"{_short(problem['input'])} does not match {problem['ctx']['pattern']}"
        case "string_type":
            message = f"expected text, found {_short(problem['input'])}; put it in quotes"
        case _:
            message = f"{problem['msg'][:1].lower()}{problem['msg'][1:]}, found {_short(problem['input'])}"
    return Finding(document.file, *document.place(path), f"{name}: {message}")


def _without_tags(loc: tuple[str | int, ...]) -> tuple[str | int, ...]:
    """A path in the file of a path in the model, which also names the kind of a stream and calls keys `[key]`."""
    path: list[str | int] = []
    for i, part in enumerate(loc):
        if part == "[key]":
            continue
        if part in GROUPS and i == 2 and loc[0] == "streams":
            continue
        path.append(part)
    return tuple(path)


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:60] + "…"
