"""Where formulas over numbers are unknown: where a signal is missing, and everywhere where one is no number."""

from __future__ import annotations

from collections.abc import Iterator

from oracle_server.core.errors import SpecProblem
from oracle_server.core.hazards.lacks import quoted
from oracle_server.core.hazards.misfits import described, range_at
from oracle_server.core.hazards.places import Place, names_of, places
from oracle_server.core.spec import Property, Spec
from oracle_server.core.typed import StreamTypes


def gaps(spec: Spec, types: StreamTypes) -> Iterator[SpecProblem]:
    """Warnings about formulas over numbers, of a spec without errors, whose messages have these types."""
    numeric = [(i, prop) for i, prop in enumerate(spec.properties) if prop.numeric]
    where = places(spec, "steps", types) if numeric else []
    for i, prop in numeric:
        for message in (*_texts(prop, where), *_lacking(prop, where)):
            yield SpecProblem(("properties", i, "formula"), message, severity="warning", kind="unjudged")


def _texts(prop: Property, where: list[Place]) -> Iterator[str]:
    for key in _read(prop):
        having = [place for place in where if place.has(key)]
        found = range_at(key, having)
        if having and not found.has_numbers:
            yield (
                f"property '{prop.id}' is never judged: `{key}` of {names_of(having)} is always {described(found)}, "
                "and no number"
            )


def _lacking(prop: Property, where: list[Place]) -> Iterator[str]:
    read = [key for key in _read(prop) if any(place.has(key) for place in where)]
    lacking = {place.name: [key for key in read if not place.has(key)] for place in where}
    listed = ", ".join(f"{stream} ({', '.join(keys)})" for stream, keys in lacking.items() if keys)
    if read and not any(all(place.has(key) for key in read) for place in where):
        yield f"property '{prop.id}' is never judged: no step has all of {quoted(read)}; `hold` keeps the last value"
    elif listed:
        yield f"property '{prop.id}' is unknown where a signal is missing: {listed}; `hold` keeps the last value"


def _read(prop: Property) -> list[str]:
    return list(dict.fromkeys(c.key for atom in prop.atoms for c in atom.constraints))
