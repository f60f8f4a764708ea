"""Comparisons of derived signals that time changes with other signals: which of them ticks can't be told for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from oracle_server.core.atoms import specialise
from oracle_server.core.comparisons import turned
from oracle_server.core.derived.definition import Definition
from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.ahead import looks_ahead
from oracle_server.core.formula.render import render_atom
from oracle_server.core.formula.tree import Signal
from oracle_server.core.spec import Spec


def uncompared(spec: Spec) -> Iterator[SpecProblem]:
    """Comparisons that may turn without a step, where nothing tells when: they are refused with `time: seconds`.

    What waits for what comes is judged at steps alone.
    """
    known = {d.name: d for d in spec.derive}
    between = {*spec.kept, *(by for d in spec.derive for by in d.by)}
    for i, prop in enumerate(spec.properties):
        for atom in prop.atoms if prop.time == "seconds" and not looks_ahead(prop.formula) else ():
            if not specialise([atom], {}, between.__contains__):
                continue
            for constraint in atom.constraints:
                sides = (constraint, turned(constraint)) if isinstance(constraint.value, Signal) else ()
                found = ((side.key, why) for side in sides if (why := _why_not(side.key, _other(side.value), known)))
                name, why = next(found, ("", ""))
                if why:
                    message = (
                        f"formula of '{prop.id}': `{render_atom(atom)}` compares '{name}', which changes with time, "
                        f"with {why}; with `time: seconds` compare it with a number, a held signal, or another "
                        "`count`, `rate`, `sum`, `mean`, `min` or `max` that is kept by the same, or write "
                        "`time: steps`"
                    )
                    yield SpecProblem(("properties", i, "formula"), message, atom.at)


def _other(value: object) -> str:
    return value.name if isinstance(value, Signal) else ""


def _why_not(name: str, other: str, known: Mapping[str, Definition]) -> str:
    """What is wrong with what a derived signal is compared with, empty where it is not, or where it changes nothing."""
    own, beside = known.get(name), known.get(other)
    if own is None or not own.changes:
        return ""
    if beside is not None and beside.changes:
        if own.by != beside.by:
            kept = f"is kept by `{beside.by[0]}`" if beside.by else f"is not kept by `{own.by[0]}`"
            return f"'{other}', which {kept}"
        mixed = own.op != beside.op and "age" in (own.op, beside.op)
        return f"'{other}', which is kept by `{own.by[0]}`" if own.by and mixed else ""
    if _changes(other, known):
        return f"'{other}', which is computed of what changes with time"
    by = next((by for by in _keys(other, known)), "")
    if by:
        return f"'{other}', which is kept by `{by}`"
    return f"'{other}', by which it is kept" if own.op == "age" and own.by and _reads(other, own.by[0], known) else ""


def _changes(name: str, known: Mapping[str, Definition]) -> bool:
    """Whether time alone may change a signal, be it through others."""
    found = known.get(name)
    return found is not None and (found.changes or any(_changes(each, known) for each in _at_once(found)))


def _keys(name: str, known: Mapping[str, Definition]) -> Iterator[str]:
    """The signals by which it is kept, or another that it is computed of at once."""
    found = known.get(name)
    if found is not None:
        yield from found.by
        for each in _at_once(found):
            yield from _keys(each, known)


def _reads(name: str, wanted: str, known: Mapping[str, Definition]) -> bool:
    """Whether a signal is another, or computed of it at once."""
    found = known.get(name)
    return name == wanted or (found is not None and any(_reads(each, wanted, known) for each in _at_once(found)))


def _at_once(definition: Definition) -> tuple[str, ...]:
    """The signals on which a derived one depends without a step."""
    if definition.op in ("expression", "previous", "delta"):
        return definition.reads
    return definition.by
