"""The command `import --fret`: writes a spec of requirements, with a comment wherever one has no counterpart."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from oracle_server.core.errors import SpecError, one_line
from oracle_server.core.formula.parse import MAX_TEXT
from oracle_server.core.sentences.requirement import CONDITIONS, SCOPES, TIMINGS
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.fret.read import FIRST, Export, FretError, Requirement, Source, read_export, read_sources
from oracle_server.specfiles.imported import Imported, write_spec
from oracle_server.specfiles.load import parse_spec

_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)
_TOPIC = re.compile(r"/?[A-Za-z_][A-Za-z0-9_/]*")
_TYPE = re.compile(r"\w+(/msg)?/\w+", re.ASCII)
_FIELD = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*", re.ASCII)
_READ = re.compile(r"\b([A-Za-z_]\w*)(?:\s*(<=|>=|<|>|=)\s*(-?\d{1,15}(?:\.\d{1,15})?)(?!\w|\.\d)|\b)", re.ASCII)
_FIRST = re.compile(rf"\b{FIRST}\b(?!\s+(?i:shall)\b)", re.ASCII)
_BEFORE_SHALL = re.compile(r"\s+shall\b", re.IGNORECASE)
_WORDS = frozenset(
    (
        *SCOPES,
        *CONDITIONS,
        *TIMINGS,
        "shall",
        "the",
        "then",
        "and",
        "or",
        "not",
        "mode",
        "at",
        "timepoint",
        "only",
        "true",
        "false",
    )
)
_STUB = "todo"
MOST_VARIABLES = 300


@dataclass(frozen=True, slots=True)
class _Read:
    """A requirement that was read: its id and sentence here, the variables in it, and why it is a stub, or empty."""

    id: str
    was: Requirement
    text: str
    names: tuple[str, ...]
    refused: str = ""


def import_fret(path: Path, variables: Path | None, out: Path | None, types: Types) -> Imported:
    """Write the spec of an export of FRET, or print it, and check it. Raises `FretError`, `NotWrittenError`."""
    export = read_export(path)
    sources = _usable(read_sources(variables) if variables else {})
    found = _all_read(export, sources, types)
    if len({name for each in found for name in each.names}) > MOST_VARIABLES:
        raise FretError(f"{path}: more than {MOST_VARIABLES} variables in its sentences: export fewer requirements")
    text = _spec_text(path.name, found, sources)
    findings = write_spec(text, out, types)
    stubs = [f"the formula of {each.id}" for each in found if each.refused]
    unbound = _unbound(found, sources)
    judges = any(not each.refused and not unbound.intersection(each.names) for each in found)
    return Imported((*sorted(unbound), *stubs), (), findings, judges=judges)


def _usable(sources: dict[str, list[Source]]) -> dict[str, Source]:
    """The variables that come from one topic, and from a field that is known; the rest is left to be written."""
    found = {}
    for name, listed in sources.items():
        if len(set(listed)) == 1 and _TOPIC.fullmatch(listed[0].topic) and _TYPE.fullmatch(listed[0].type):
            field = listed[0].field or ("data" if listed[0].type.startswith("std_msgs/") else "")
            if _FIELD.fullmatch(field):
                found[name] = Source(listed[0].topic, listed[0].type, field)
    return found


def _all_read(export: Export, sources: dict[str, Source], types: Types) -> list[_Read]:
    known = export.variables.union(sources)
    ids: set[str] = set()
    found = []
    for was in export.requirements:
        read = _read(was, _id(was.id, ids), known)
        if not read.refused:
            read = _checked(read, sources, types)
        found.append(read)
    return found


def _id(text: str, taken: set[str]) -> str:
    """An id of a property: the requirement's, as far as it may be one, and not that of another."""
    plain = re.sub(r"[^A-Za-z0-9_.-]", "_", text)[:50].lstrip("_.-") or "requirement"
    name, number = plain, 1
    while name in taken:
        number += 1
        name = f"{plain}_{number}"
    taken.add(name)
    return name


def _read(was: Requirement, name: str, known: frozenset[str]) -> _Read:
    """A requirement whose variables, and comparisons with numbers, stand in braces, or why it can't be taken."""
    if len(was.text) > MAX_TEXT:
        return _Read(name, was, "", (), f"the sentence has {len(was.text):,} characters; at most {MAX_TEXT} are read")
    strange = next(
        (c for c in was.text if c in "{[/~^\"'" or not (c.isascii() and (c.isprintable() or c.isspace()))), ""
    )
    if strange:
        return _Read(name, was, "", (), f"{strange!r} in a sentence is not taken")
    if len(re.findall("[=-]>", was.text)) > 1:
        return _Read(
            name, was, "", (), "how several `=>` are grouped is not said: put them in requirements of their own"
        )
    words = dict.fromkeys(_NAME.findall(was.text))
    names = tuple(word for word in words if word in known)
    unclear = next((word for word in names if word.lower() in _WORDS or word == _STUB), "")
    if unclear:
        return _Read(name, was, "", (), f"the variable `{unclear}` is called as a word of sentences is: rename it")

    def braced(match: re.Match[str]) -> str:
        name, sign, number = match.groups()
        if name not in known or (not sign and _BEFORE_SHALL.match(match.string, match.end())):
            return match[0]
        return f"{{{name}{f': {number}' if sign == '=' else f' {sign} {number}' if sign else ''}}}"

    return _Read(name, was, _READ.sub(braced, " ".join(was.text.split())), names)


def _checked(read: _Read, sources: dict[str, Source], types: Types) -> _Read:
    """The same, or with the reason for which `check` refuses it."""
    try:
        parse_spec(_spec_text("", [read], sources), "spec.yaml", types=types)
    except SpecError as error:
        return _Read(read.id, read.was, "", (), error.findings[0].message)
    return read


def _unbound(found: Sequence[_Read], sources: dict[str, Source]) -> set[str]:
    """The variables that sentences read, and that come from nowhere that is known."""
    return {name for each in found for name in each.names if name not in sources}


def _spec_text(source: str, found: Sequence[_Read], sources: dict[str, Source]) -> str:
    """The text of the spec."""
    names = list(dict.fromkeys(name for each in found for name in each.names))
    unbound = sorted(_unbound(found, sources))
    if any(each.refused for each in found):
        unbound.append(_STUB)
    lines = [
        f"# Imported from {one_line(source).encode('utf-8', 'replace').decode()} by `oracle-server import --fret`. "
        "Check the lines marked TODO.",
        "# A step is a message of any stream, and what a topic says holds until its next message; before its first one",
        "# a variable is absent, and all that is said of it is false.",
        "id: fret",
    ]
    topics: dict[tuple[str, str], list[str]] = {}
    for name in names:
        if name in sources:
            topics.setdefault((sources[name].topic, sources[name].type), []).append(name)
    if any(FIRST not in each.names and _FIRST.search(each.text) for each in found):
        lines += ["define:", f"  {FIRST}: first"]
    lines.append("streams:")
    for (topic, type_), of_it in topics.items():
        lines += [
            f"  - topic: {json.dumps(topic)}",
            f"    type: {type_}",
            f"    hold: [{', '.join(map(json.dumps, of_it))}]",
            "    signals:",
        ]
        lines += [f"      {json.dumps(name)}: msg.{sources[name].field}" for name in of_it]
        lines += _todos(unbound)
    if not topics:
        lines += ["  - topic: /todo   # TODO: the topics of the variables", "    signals:"]
        lines += _todos(unbound) or ["      todo: todo()"]
    lines.append("properties:")
    for each in found:
        lines += _property(each)
    return "\n".join(lines) + "\n"


def _todos(unbound: Sequence[str]) -> list[str]:
    """The signals of variables of which nothing is known: they fail at each event, so that nothing is made of them."""
    lines = []
    for name in unbound:
        if name != _STUB:
            lines.append(f"      # TODO: say in CEL where {name} comes from; until then its requirements are unknown")
        lines.append(f"      {json.dumps(name)}: todo()")
    return lines


def _property(read: _Read) -> list[str]:
    lines = [f"  - id: {json.dumps(read.id)}"]
    if read.was.rationale.strip():
        lines.append(f"    # {_comment(read.was.rationale)}")
    if read.refused:
        lines += [f"    # TODO: {_comment(read.refused)}. It was:", f"    # {_comment(read.was.text)}"]
        return [*lines, "    formula: '{todo}'"]
    return [*lines, f"    requirement: {json.dumps(read.text)}"]


def _comment(text: str) -> str:
    """A text as a part of one line of a comment."""
    return one_line(" ".join(text.split()))[:1_000]
