"""The command `import --diagram`: writes a spec with the machine of a state diagram."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

from oracle_server.core.errors import one_line
from oracle_server.core.formula.render import render_atom
from oracle_server.core.formula.tree import Atom, Constraint
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.diagrams.read import Arrow, Diagram, DiagramError, read_diagram
from oracle_server.specfiles.imported import Imported, write_spec

_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)
_NUMBER = re.compile(r"-?\d{1,15}(\.\d{1,15})?")
_COMPARED = re.compile(r"\(?\s*([A-Za-z_]\w*)\s*(==|!=|<=|>=|<|>)\s*(-?\d{1,15}(?:\.\d{1,15})?)\s*\)?", re.ASCII)
_JOINED = re.compile(r"&&|\band\b", re.IGNORECASE)
_EVENT = "event"


def import_diagram(path: Path, out: Path | None, types: Types) -> Imported:
    """Write the spec of a diagram, or print it, and check it. Raises `DiagramError`, `NotWrittenError`."""
    diagram = read_diagram(path)
    text, todos = _spec_text(path, diagram)
    findings = write_spec(text, out, types)
    return Imported(tuple(todos), (), findings, judges=False)


def _spec_text(path: Path, diagram: Diagram) -> tuple[str, list[str]]:
    """The text of the spec, and the signals that are left to be written."""
    name = re.sub(r"\W+", "_", path.stem, flags=re.ASCII)[:50].strip("_") or "machine"
    labelled = any(arrow.label for arrow in diagram.arrows)
    derive = _by_events(path, diagram) if labelled else _by_values(diagram)
    signals = ["mode"]
    define: list[str] = []
    if labelled:
        events = _events(diagram)
        meant = {event: _meant(label) for label, event in events.items()}
        define = ["define:", *(f"  {event}: {json.dumps(formula)}" for event, (_, formula) in meant.items())]
        signals = list(dict.fromkeys(signal for named, _ in meant.values() for signal in named))
    source = one_line(path.name).encode("utf-8", "replace").decode()
    lines = [
        f"# Imported from {source} by `oracle-server import --diagram`. Check the lines marked TODO.",
        f"id: {json.dumps(name)}",
        "streams:",
        "  - topic: /todo   # TODO: the topic that tells of it",
        "    signals:",
        *(
            f"      {signal}: todo()   # TODO: say in CEL where it comes from; until then all is unknown"
            for signal in signals
        ),
        *define,
        "derive:",
        *derive,
        "properties:",
        "  - {id: machine_ok, machine: machine}",
    ]
    return "\n".join(lines) + "\n", signals


def _by_values(diagram: Diagram) -> Iterator[str]:
    """A machine that follows a signal: no arrow has a label."""
    yield from ("  machine:", "    follows: mode", "    states:")
    for state in diagram.states:
        targets = dict.fromkeys(a.to for a in diagram.arrows if a.state == state)
        yield f"      {json.dumps(state)}: [{', '.join(map(json.dumps, targets))}]"


def _by_events(path: Path, diagram: Diagram) -> Iterator[str]:
    """A machine by its events, which are the labels."""
    events = _events(diagram)
    start = diagram.start or next(iter(diagram.states))
    yield from ("  machine:", f"    start: {json.dumps(start)}", "    states:")
    for state in diagram.states:
        row: dict[str, Arrow] = {}
        for arrow in (a for a in diagram.arrows if a.state == state):
            if not arrow.label:
                raise DiagramError(f"{path}:{arrow.line}: the arrow to `{arrow.to}` has no label, and others have one")
            if {"'", '"'} <= set(arrow.label):
                raise DiagramError(
                    f"{path}:{arrow.line}: the label {json.dumps(arrow.label)} has both kinds of quotes, and a text in "
                    "a formula has one of them at most: leave one kind out"
                )
            first = row.setdefault(events[arrow.label], arrow)
            if first.to != arrow.to:
                raise DiagramError(
                    f"{path}:{arrow.line}: `{arrow.label}` leads from `{state}` to `{arrow.to}` here, and in line "
                    f"{first.line} to `{first.to}`"
                )
        ways = {event: arrow.to for event, arrow in row.items()}
        # a comparison holds at message after message: where a state has no arrow for it, it changes nothing
        ways |= {event: state for label, event in events.items() if _compared(label) and event not in row}
        yield f"      {json.dumps(state)}: {{{', '.join(f'{event}: {json.dumps(to)}' for event, to in ways.items())}}}"


def _events(diagram: Diagram) -> dict[str, str]:
    """A name for each label."""
    found: dict[str, str] = {}
    taken: set[str] = set()
    for arrow in diagram.arrows:
        if arrow.label and arrow.label not in found:
            plain = f"on_{re.sub(r'[^A-Za-z0-9]+', '_', arrow.label)[:40].strip('_')}"
            name, number = plain, 1
            while name in taken:
                number += 1
                name = f"{plain}_{number}"
            taken.add(name)
            found[arrow.label] = name
    return found


def _meant(label: str) -> tuple[list[str], str]:
    """The signals that a label is of, and its formula: comparisons with numbers, or a value of `event`."""
    if parts := _compared(label):
        return [signal for signal, *_ in parts], " and ".join(f"{{{' '.join(part)}}}" for part in parts)
    plain = _NAME.fullmatch(label) or _NUMBER.fullmatch(label)
    if plain and label not in ("true", "false"):
        return [_EVENT], f"{{{_EVENT}: {label}}}"
    return [_EVENT], render_atom(Atom((Constraint(_EVENT, "==", label),)))


def _compared(label: str) -> list[tuple[str, ...]]:
    """The comparisons that a label is, each as a signal, a sign and a number; none where it is anything else."""
    found = [_COMPARED.fullmatch(part.strip()) for part in _JOINED.split(label)]
    return [match.groups() for match in found if match] if all(found) else []
