"""Copies in which something was to be changed: properties that ask the same, and signals that read the same field."""

from __future__ import annotations

from collections.abc import Iterator

from oracle_server.core.errors import SpecProblem
from oracle_server.core.hazards.readings import at
from oracle_server.core.shapes import Record
from oracle_server.core.spec import Property, Spec
from oracle_server.core.typed import StreamTypes

_SHORT = 3
"""Most letters of a name that may end with an axis, as `wy` does, and `gravity` does not."""


def asked_twice(spec: Spec) -> Iterator[SpecProblem]:
    """Warnings of properties that differ from one before in their names alone; what is still to be written is none."""
    seen: dict[object, str] = {}
    unwritten = {
        name
        for stream in spec.streams
        for name, text in (stream.signals or {}).items()
        if "todo" in text and stream.read(text).unwritten
    }
    for i, prop in enumerate(spec.properties):
        if unwritten & {c.key for atom in prop.atoms for c in atom.constraints}:
            continue
        first = seen.setdefault(_key(prop), prop.id)
        if first != prop.id:
            message = f"'{prop.id}' asks just what '{first}' does; change what was to be another, or leave it out"
            yield SpecProblem(("properties", i, "id"), message, severity="warning")


def read_twice(spec: Spec, types: StreamTypes) -> Iterator[SpecProblem]:
    """Warnings of signals that read what another one does, beside a field that is called as they are."""
    for i, stream in enumerate(spec.streams):
        known = types.get(stream.key)
        seen: dict[str, str] = {}
        for name, text in (stream.signals or {}).items() if known is not None else ():
            first = seen.setdefault(text.strip(), name)
            meant = _meant(name, text.strip(), known.widest) if known is not None and first != name else ""
            if meant:
                message = f"signal '{name}': it reads what '{first}' does, `{text.strip()}`; was `{meant}` meant?"
                yield SpecProblem(("streams", i, "signals", name), message, severity="warning")


def _key(prop: Property) -> object:
    settings = (prop.time, prop.guards, prop.blame, prop.latch, prop.at_end, prop.engine, prop.external)
    return prop.says, prop.text.strip(), settings


def _meant(name: str, text: str, shape: Record) -> str:
    """The field beside the one that is read as which a signal is called, as `msg.position.y` of `y`; mostly empty."""
    *path, read = text.split(".")
    if not path or path[0] != "msg":
        return ""
    within = at(shape, tuple(path[1:]))
    beside = within.fields if isinstance(within, Record) and read in within.fields else {}
    found = next((field for field in beside if field != read and _is_called(name, field)), None)
    return "" if found is None or _is_called(name, read) else ".".join((*path, found))


def _is_called(name: str, field: str) -> bool:
    return (
        name == field or name.endswith(f"_{field}") or (len(field) == 1 and len(name) <= _SHORT and name[-1] == field)
    )
