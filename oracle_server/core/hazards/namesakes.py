"""Words without quotes, which atoms take for texts: `{speed == limit}` asks for "limit", `{goal: g}` for "g"."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set

from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.tree import Atom, Constraint
from oracle_server.core.hazards.misfits import constraint_text, range_at
from oracle_server.core.hazards.places import Place, places
from oracle_server.core.kinds import NAMING
from oracle_server.core.ranges import Range, ValueKind
from oracle_server.core.signals import is_signal
from oracle_server.core.spec import Spec
from oracle_server.core.typed import StreamTypes

_BOOLEANS = "a Boolean is written `{value}`"
_NOTHING = "a field without a value makes its signal absent, which no atom is true of: write `not {{{key}: *}}`"
_FINITE = "a signal is never NaN or infinite, since it then fails, and what reads it is unknown"
_MEANT: Mapping[str, tuple[str, frozenset[ValueKind]]] = {
    **dict.fromkeys(("True", "TRUE", "False", "FALSE"), (_BOOLEANS, frozenset({"boolean"}))),
    **dict.fromkeys(("None", "null", "Null", "NULL", "nil"), (_NOTHING, frozenset({"boolean", "number"}))),
    **dict.fromkeys(
        ("nan", "NaN", "NAN", "inf", "Inf", "INF", "infinity", "Infinity"), (_FINITE, frozenset({"number"}))
    ),
}
"""Words that other languages have for values, with what is said of them, of a signal that may be of some kinds.

`NONE` and `none` are texts in robots' messages, as of a fault.
"""


def namesakes(spec: Spec, types: StreamTypes) -> Iterator[SpecProblem]:
    """Warnings about formulas of a spec without errors, whose messages have these types."""
    names = named(spec)
    for i, prop in enumerate(spec.properties):
        variables = frozenset(variable for atom in prop.atoms for _, variable in atom.refs)
        if any(c.bare and _is_doubtful(c.value, names | variables) for atom in prop.atoms for c in atom.constraints):
            where = places(spec, prop.time, types)
            for atom in prop.atoms:
                for message in namesake(atom, names, where, variables):
                    text = f"formula of '{prop.id}': {message}"
                    yield SpecProblem(("properties", i, "formula"), text, atom.at, severity="warning")


def named(spec: Spec) -> frozenset[str]:
    """The names of all signals that a spec declares or derives."""
    declared = frozenset[str]().union(*(stream.signals or () for stream in spec.streams))
    return declared.union(definition.name for definition in spec.derive)


def namesake(atom: Atom, names: Set[str], where: Sequence[Place], variables: Set[str] = frozenset()) -> Iterator[str]:
    """What is said of the texts in an atom without quotes that are names of signals, of variables, or other words.

    Nothing where the signal is known to have such a text, or no value in common with the other one.
    """
    for constraint in atom.constraints:
        key, name = constraint.key, constraint.value
        if not (constraint.bare and isinstance(name, str)) or key in NAMING:
            continue
        if name not in variables and (key == name or not _is_doubtful(name, names)):
            continue
        found = range_at(key, [p for p in where if p.allows(atom) and not p.lacks(atom)])
        if name in found.values:
            continue
        if name in variables:
            yield (
                f'`{_written(constraint)}` asks for the text "{name}", and not for the value of the variable `{name}`; '
                f"write `*{name}`, or put the text in quotes if it is meant"
            )
            continue
        if name not in names:
            yield from _foreign(constraint, name, found)
            continue
        if not found.overlaps(range_at(name, [p for p in where if p.has(name)])):
            continue
        yield (
            f'`{_written(constraint)}` asks for the text "{name}", and not for the value of the signal `{name}`; put '
            f"the text in quotes if it is meant, and compare the signals by a third one, as `same: {key} == {name}` "
            "under `derive`, if not"
        )


def _is_doubtful(value: object, names: Set[str]) -> bool:
    return isinstance(value, str) and (value in names or value in _MEANT)


def _foreign(constraint: Constraint, word: str, found: Range) -> Iterator[str]:
    """What is said of another language's word for a value, where the signal may be a text and may have it."""
    told, kinds = _MEANT[word]
    if is_signal(word) and "text" in found.kinds and found.kinds & kinds:
        mend = told.format(key=constraint.key, value=word.lower())
        what = f'`{_written(constraint)}` asks for the text "{word}"'
        yield f"{what}, which is to be put in quotes if it is meant; {mend}"


def _written(constraint: Constraint) -> str:
    return constraint_text(constraint).replace('"', "")
