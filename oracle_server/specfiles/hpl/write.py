"""The command `import --hpl`: writes a spec of patterns, with a comment wherever a property has no counterpart."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from oracle_server.core.errors import Finding, SpecError, one_line
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.hpl.draft import Draft, Signals
from oracle_server.specfiles.hpl.parse import read_properties
from oracle_server.specfiles.hpl.pattern import pattern
from oracle_server.specfiles.hpl.scan import Scanner
from oracle_server.specfiles.hpl.shared import both, implies
from oracle_server.specfiles.hpl.tree import Event, HplError, NoCounterpartError, Property
from oracle_server.specfiles.imported import Imported, write_spec
from oracle_server.specfiles.load import parse_spec

MOST_BYTES = 1_000_000
_STUB = "todo"


@dataclass(frozen=True, slots=True)
class _Read:
    """A property that was read: its id and pattern here, or why it is a stub; what is to be looked at, with places."""

    id: str
    was: Property
    pattern: str
    refused: str = ""
    doubtful: tuple[tuple[int, str], ...] = ()


def import_hpl(path: Path, out: Path | None, types: Types) -> Imported:
    """Write the spec of properties in HPL, or print it, and check it. Raises `HplError`, `NotWrittenError`."""
    source = _text(path)
    signals: Signals = {}
    found = list(_all_read(source, str(path), signals, types))
    text = _spec_text(path.name, found, signals)
    findings = write_spec(text, out, types)
    place = Scanner(source, str(path)).place
    doubts = [Finding(str(path), *place(at), told, "warning") for each in found for at, told in each.doubtful]
    stubs = tuple(f"the pattern of {each.id}" for each in found if each.refused)
    return Imported(stubs, (), (*doubts, *findings), judges=any(not each.refused for each in found))


def _text(path: Path) -> str:
    try:
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise HplError(f"{path}: can't be read: {error.strerror}") from None
    if len(data) > MOST_BYTES:
        raise HplError(f"{path}: more than {MOST_BYTES // 10**6} MB, which is more than is read")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise HplError(f"{path}: not UTF-8: byte {error.start}") from None


def _all_read(source: str, file: str, signals: Signals, types: Types) -> Iterator[_Read]:
    """Each property, whose signals are added to those that are there."""
    scanner = Scanner(source, file)
    ids: set[str] = set()
    for i, prop in enumerate(read_properties(source, file)):
        name = _id(prop.id or f"p{i + 1}", ids)
        own: Signals = {topic: dict(known) for topic, known in signals.items()}
        try:
            _check_answers(prop)
            draft = Draft(prop, source, own)
            read = _Read(name, prop, pattern(draft), doubtful=tuple(_doubts(prop)))
            _check(read, draft.used, types)
        except NoCounterpartError as error:
            line, column = scanner.place(error.at)
            yield _Read(name, prop, "", f"{error.message} (line {line}, column {column})")
        else:
            signals.update(own)
            yield read


def _id(text: str, taken: set[str]) -> str:
    """An id of a property: the one in HPL as far as it may be one, and not that of another."""
    plain = re.sub(r"[^A-Za-z0-9_.-]", "_", text)[:50].lstrip("_.-") or "property"
    name, number = plain, 1
    while name in taken:
        number += 1
        name = f"{plain}_{number}"
    taken.add(name)
    return name


def _check(read: _Read, signals: Signals, types: Types) -> None:
    """Refuse what `check` refuses."""
    try:
        parse_spec(_spec_text("", [read], signals), "spec.yaml", types=types)
    except SpecError as error:
        raise NoCounterpartError(error.findings[0].message, read.was.at) from None


def _check_answers(prop: Property) -> None:
    """Refuse what is always met, or never, where one message counts as both events."""
    for one, other in both(prop.trigger, prop.behaviour):
        triggers, answers = implies(one, other), implies(other, one)
        if (triggers and prop.verb != "requires") or (answers and prop.verb != "causes"):
            raise NoCounterpartError(
                f"each such message on {other.topic} is both events, and would answer itself", other.at
            )
    for one, other in both(prop.opens, prop.closes):
        if implies(one, other) or implies(other, one):
            raise NoCounterpartError(
                f"each such message on {other.topic} would both open the scope and close it", other.at
            )


def _doubts(prop: Property) -> Iterator[tuple[int, str]]:
    """What one message may be twice, which counts twice here, and once in HPL."""
    for one, other in both(prop.trigger, prop.behaviour):
        yield other.at, _twice(one, other, "answers itself")
    for one, other in both(prop.opens, prop.closes):
        yield other.at, _twice(one, other, "leaves the scope open")


def _twice(one: Event, other: Event, does: str) -> str:
    told = f"`{one.alias}`" if one.alias else "an event before"
    return f"{other.topic} is the topic of {told} too: a message that is both {does} here, and does not in HPL"


def _spec_text(source: str, found: Sequence[_Read], signals: Signals) -> str:
    """The text of the spec."""
    stubs = any(each.refused for each in found)
    lines = [
        f"# Imported from {_comment(source)} by `oracle-server import --hpl`. Check the lines marked TODO.",
        "# HPL says no types: with `type:` at each topic, `check` knows the fields of its messages.",
        f"id: {_id(Path(source).stem, set())}",
        "streams:",
    ]
    topics = dict.fromkeys(e.topic for each in found for e in each.was.events() if not e.topic.startswith("~"))
    for topic in topics or ["/todo"]:
        lines.append(f"  - topic: {topic}")
        known = signals.get(topic, {}) | ({_STUB: "todo()"} if stubs else {})
        lines.append("    signals:" if known else "    signals: {}")
        lines += [f"      {_plain(name)}: {_plain(text)}" for name, text in known.items()]
    lines.append("properties:")
    for each in found:
        lines += _property(each)
    return "\n".join(lines) + "\n"


def _property(read: _Read) -> list[str]:
    was = read.was
    lines = [f"  - id: {json.dumps(read.id)}"]
    told = ". ".join(" ".join(text.split()).rstrip(".") for text in (was.title, was.description) if text.strip())
    if told:
        lines.append(f"    description: {_quoted(_comment(told))}")
    lines += [f"    # TODO: {_comment(read.refused)}. It was:"] if read.refused else []
    lines += [f"    # {_comment(was.text)}"]
    lines += [f"    # look at it: {_comment(told)}" for _, told in read.doubtful]
    if read.refused:
        return [*lines, f"    formula: '{{{_STUB}}}'"]
    return [*lines, f"    pattern: {_quoted(read.pattern)}", "    latch: true"]


def _plain(text: str) -> str:
    """A text of YAML, in quotes unless it begins as a field of a message."""
    return text if re.fullmatch(r"msg(\.[A-Za-z_]\w*)+|todo(\(\))?", text, re.ASCII) else _quoted(text)


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"


def _comment(text: str) -> str:
    """A text as a part of one line."""
    return one_line(" ".join(text.split())).encode("utf-8", "replace").decode()[:1_000]
