"""The command `import --fret`: writes a spec of requirements, with a comment wherever one has no counterpart."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from oracle_server.core.errors import SpecError, one_line
from oracle_server.core.formula.parse import MAX_TEXT
from oracle_server.core.sentences.requirement import CONDITIONS, SCOPES, TIMINGS
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.fret.read import (
    FIRST,
    NUMBER,
    Export,
    FretError,
    Requirement,
    Source,
    read_export,
    read_sources,
)
from oracle_server.specfiles.imported import Imported, write_spec
from oracle_server.specfiles.load import parse_spec

_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)
_TOPIC = re.compile(r"/?[A-Za-z_][A-Za-z0-9_/]*")
_TYPE = re.compile(r"\w+(/msg)?/\w+", re.ASCII)
_FIELD = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*", re.ASCII)
_SIGN = "<=|>=|<|>|="
_TURNED = {"<=": ">=", ">=": "<=", "<": ">", ">": "<", "=": "="}
"""What stands between a number and a variable, as it stands between the variable and the number."""
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
    """A requirement that was read: its id and sentence here, the variables in it, and why it is a stub, or empty.

    `constants` are the names in it that stand for numbers, with these.
    """

    id: str
    was: Requirement
    text: str
    names: tuple[str, ...]
    refused: str = ""
    constants: tuple[tuple[str, str], ...] = ()


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
    constants = {name: number for name, number in export.constants.items() if name not in sources}
    known = export.variables.union(sources).difference(constants)
    ids: set[str] = set()
    found = []
    for was in export.requirements:
        read = _read(was, _id(was.id, ids), known, constants)
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


def _read(was: Requirement, name: str, known: frozenset[str], constants: Mapping[str, str]) -> _Read:
    """A requirement whose variables, and comparisons with numbers, stand in braces, or why it can't be taken.

    `constants` are names that stand for numbers.
    """
    if len(was.text) > MAX_TEXT:
        return _Read(name, was, "", (), f"the sentence has {len(was.text):,} characters; at most {MAX_TEXT} are read")
    strange = next(
        (c for c in was.text if c in "{[/~^\"'" or not (c.isascii() and (c.isprintable() or c.isspace()))), ""
    )
    if strange:
        return _Read(name, was, "", (), f"{strange!r} in a sentence is not taken")
    if len(re.findall("[=-]>", was.text)) > 1:
        return _Read(
            name,
            was,
            "",
            (),
            "how several `=>` or `<=>` are grouped is not said: put them in requirements of their own",
        )
    words = dict.fromkeys(_NAME.findall(was.text))
    names = tuple(word for word in words if word in known)
    unclear = next((word for word in names if word.lower() in _WORDS or word == _STUB), "")
    if unclear:
        return _Read(name, was, "", (), f"the variable `{unclear}` is called as a word of sentences is: rename it")

    used = tuple((word, constants[word]) for word in words if word in constants)
    return _Read(name, was, _braced(" ".join(was.text.split()), known, constants), names, constants=used)


def _braced(text: str, known: frozenset[str], constants: Mapping[str, str]) -> str:
    """A sentence with its variables, and their comparisons with numbers and constants, in braces."""
    number = rf"(?<![\w.]){NUMBER}(?!\w|\.\d)" + "".join(rf"|\b{name}\b" for name in constants if _NAME.fullmatch(name))
    turned = rf"(?P<before>{number})\s*(?P<turned>{_SIGN})\s*(?P<behind>{_NAME.pattern})\b"
    plain = rf"\b(?P<name>{_NAME.pattern})\b(?:\s*(?P<sign>{_SIGN})\s*(?P<number>{number}))?"

    def braced(match: re.Match[str]) -> str:
        name, sign, value = match["name"], match["sign"], match["number"]
        if name is None:
            name, sign, value = match["behind"], _TURNED[match["turned"]], match["before"]
        if name not in known or (not sign and _BEFORE_SHALL.match(text, match.end())):
            return match[0]
        value = constants.get(value, value)
        return f"{{{name}{f': {value}' if sign == '=' else f' {sign} {value}' if sign else ''}}}"

    return re.sub(f"{turned}|{plain}", braced, text, flags=re.ASCII)


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
    if read.constants:
        lines.append(f"    # {', '.join(f'{name} is {number}' for name, number in read.constants)}")
    return [*lines, f"    requirement: {json.dumps(read.text)}"]


def _comment(text: str) -> str:
    """A text as a part of one line of a comment."""
    return one_line(" ".join(text.split()))[:1_000]
