"""Atoms that no value can meet, or every value does: what they compare does not fit the signal's expression."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from oracle_server.core.formula.render import render_atom
from oracle_server.core.formula.tree import Any, Atom, Constraint, Formula, Position, Ref, Scalar
from oracle_server.core.kinds import RESERVED
from oracle_server.core.places import Place, likened, names_of
from oracle_server.core.ranges import ANYTHING, Range

Claim = Literal["never", "met", "idle", "true", "false"]


@dataclass(frozen=True, slots=True)
class Doubt:
    """A part of a formula that hardly means what its author meant, and a claim that holds whatever comes.

    `never`: the atom holds nowhere. `met`: its constraint is met wherever the signal is there. `idle`: the
    atom might as well be false. `true`, `false`: the part does so at every event of the places that `where` names.
    """

    claim: Claim
    part: Formula
    message: str
    at: Position
    where: tuple[str, ...] = ()


def misfits(atom: Atom, places: Sequence[Place]) -> Iterator[Doubt]:
    """What no event can meet, or every event that has the signal does."""
    like = likened(atom, places)
    kinds = {id(p): p for p in like}
    possible = {key: p for key, p in kinds.items() if p.allows(atom) and not p.lacks(atom)}
    if not possible:
        return
    could = [p for p, first in zip(places, like, strict=True) if id(first) in possible]
    if all(p.misfit(atom) for p in possible.values()):
        yield Doubt("never", atom, _never(atom, could), atom.at)
        return
    for constraint in atom.constraints:
        if constraint.op != "!=" or constraint.key in RESERVED:
            continue
        if all(p.range(constraint.key).always_meets(constraint) for p in possible.values()):
            yield Doubt("met", atom, _always(constraint, could), atom.at)


def _never(atom: Atom, could: Sequence[Place]) -> str:
    own = could[0].misfit(atom)
    shown = [f"`{constraint_text(c)}`" for c in own]
    if not ANYTHING.meets(own):
        if len(own) == 1:  # an order is asked of what has none
            return f"{shown[0]} is never met: only numbers are smaller or larger"
        listed = f"{', '.join(shown[:-1])} and {shown[-1]}"
        return f"`{render_atom(atom)}` never holds: no value of `{own[0].key}` meets {listed}"
    key = own[0].key
    found = _range(key, could)
    culprit = next((c for c in own if not found.meets([c])), own[0])
    text = constraint_text(culprit)
    return f"`{text}` is never met: `{key}` of {names_of(could)} is always {_described(found)}{_mend(culprit, found)}"


def _always(constraint: Constraint, could: Sequence[Place]) -> str:
    found = _range(constraint.key, could)
    text = constraint_text(constraint)
    known = f"`{constraint.key}` of {names_of(could)} is always {_described(found)}{_mend(constraint, found)}"
    return f"`{text}` is met by every value: {known}"


def _range(key: str, could: Sequence[Place]) -> Range:
    found = Range()
    for place in could:
        found |= place.range(key)
    return found


def _described(found: Range) -> str:
    words = {"text": "a text", "number": "a number", "boolean": "true or false"}
    parts = [*(_literal(v) for v in found.values[:8]), *(words[kind] for kind in sorted(found.kinds))]
    return " or ".join(parts) or "absent"


def _mend(constraint: Constraint, found: Range) -> str:
    """What to write instead, where that is near."""
    wanted = constraint.value
    if isinstance(wanted, Any | Ref):
        return ""
    key, op = constraint.key, ":" if constraint.op == "==" else f" {constraint.op}"
    if constraint.op not in ("==", "!="):
        return "; texts and Booleans are neither smaller nor larger than a number"
    near = _near(wanted, found)
    return "" if near is None else f"; write `{key}{op} {_literal(near)}`"


def _near(wanted: Scalar, found: Range) -> Scalar | None:
    """A value that the signal can have, and that is written much like the wanted one."""
    text = _plain(wanted)
    alike = {_plain(v): v for v in found.values}
    if "boolean" in found.kinds:
        alike |= {"true": True, "false": False}
    if "number" in found.kinds and text.lstrip("-").isdecimal():
        return int(text)
    folded = {name.lower(): v for name, v in alike.items()}
    close = difflib.get_close_matches(text.lower(), folded, 1)
    if close:
        return folded[close[0]]
    return text if "text" in found.kinds and not isinstance(wanted, str) else None


def _plain(value: Scalar) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _literal(value: Scalar) -> str:
    return f'"{value}"' if isinstance(value, str) else _plain(value)


def constraint_text(constraint: Constraint) -> str:
    """A constraint as formulas write it."""
    return render_atom(Atom((constraint,)))[1:-1]
