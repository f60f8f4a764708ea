"""What a property says, as a formula, a pattern or a requirement, read as the formula that it stands for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from oracle_server.core.derived.definition import MAX_DERIVED, Definition
from oracle_server.core.errors import Finding
from oracle_server.core.formula.names import Names
from oracle_server.core.formula.tree import Time
from oracle_server.core.kinds import GROUPS
from oracle_server.core.sentences.machine import read_machine
from oracle_server.core.sentences.pattern import read_pattern
from oracle_server.core.sentences.reader import Meant
from oracle_server.core.sentences.requirement import read_requirement
from oracle_server.core.spec import Property, Spec
from oracle_server.engines.table import ENGINES
from oracle_server.specfiles.document import Document, KeyPath

Says = Literal["formula", "pattern", "requirement", "machine"]
SAYS: tuple[Says, ...] = ("formula", "pattern", "requirement", "machine")
"""The keys of which a property has one."""
ENGINES_OF_SENTENCES = ("auto", "native")
"""The engines that judge what is no formula."""


def read_said(
    document: Document,
    key: Says,
    text: str,
    engine: str,
    time: Time | None,
    names: Names,
    name: str,
    derived: Mapping[str, Definition],
) -> Meant:
    """What a property says under a key, whose `name` it is; `time` is what it says that bounds count, if it says so.

    `derived` are the derived signals by their names, of which one may be a machine.

    Raises `FormulaError` with line and column, and `EngineError` where something is not installed.
    """
    if key == "formula":
        return Meant(ENGINES[engine].read(text, time or "steps", names), time or "steps")
    if key == "pattern":
        return read_pattern(text, names, streams_of(document), time, name)
    if key == "machine":
        return read_machine(text, derived, time)
    return read_requirement(text, names, streams_of(document), time)


def streams_of(document: Document) -> Mapping[str, str]:
    """The groups of a document's streams, as `topic`, by their names, as far as there are any."""
    streams: Any = document.value.get("streams") if isinstance(document.value, dict) else None
    found = [s for s in streams if isinstance(s, dict)] if isinstance(streams, list) else []
    return {s[group]: group for s in found for group in GROUPS if isinstance(s.get(group), str)}


def measured(
    document: Document, derived: Sequence[Definition], properties: Sequence[Property], findings: list[Finding]
) -> list[Definition]:
    """The derived signals that patterns make, beside those of the file; where a name is taken is told."""
    found = [(i, each) for i, prop in enumerate(properties) for each in prop.measures]
    taken = {each.name for each in derived}
    for i, each in found:
        if each.name in taken:
            message = f"property '{properties[i].id}': its derived signal is called '{each.name}', as another is"
            findings.append(Finding(document.file, *document.place(("properties", i, "pattern")), message))
        taken.add(each.name)
    if len(derived) + len(found) > MAX_DERIVED:
        message = f"there are more than {MAX_DERIVED:,} derived signals, with those of patterns: write several specs"
        findings.append(Finding(document.file, *document.place(("properties",)), message))
        return []
    return [each for _, each in found]


def measuring(spec: Spec, path: KeyPath) -> KeyPath:
    """Where a derived signal stands in the file: in the pattern that makes it, if one does."""
    found = (i for i, prop in enumerate(spec.properties) if any(each.name == path[1] for each in prop.measures))
    index = next(found, None)
    return path if index is None else ("properties", index, "formula")
