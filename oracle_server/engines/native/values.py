"""The values at one step that make an atom hold there, or fail."""

from __future__ import annotations

from oracle_server.core.atoms import meets, precedes, shortened
from oracle_server.core.explanation import Failing
from oracle_server.core.formula import tree
from oracle_server.core.formula.tree import Any, Atom, Constraint, Limit, Ref, Scalar, Signal
from oracle_server.core.kinds import NAMING
from oracle_server.core.naming import value_text
from oracle_server.core.past import Seen
from oracle_server.engines.native.parts import Part
from oracle_server.engines.native.wording import scalar


def atom_of(part: Part) -> Atom | None:
    """The atom of a part that is one, negated or not; None for any other part."""
    formula = part.formula
    while isinstance(formula, tree.Not):
        formula = formula.operand
    return formula if isinstance(formula, Atom) else None


def failing(part: Part, atom: Atom, seen: Seen) -> tuple[Failing, ...]:
    """The constraints of an atom that a step does not meet.

    Where these are of the event itself, as its topic, only those: what another event has is another matter.
    """
    failed = [each for c in atom.constraints if (each := _failing(part, c, seen)) is not None]
    missing = {each.signal for each in failed if each.value is None}
    found = [each for each in failed if each.than not in missing]
    return tuple([each for each in found if each.signal in NAMING] or found)


def telling(part: Part, atom: Atom, seen: Seen) -> str:
    """The values with which an atom holds, as far as its text does not have them."""
    told = [c.key for c in atom.constraints if c.op != "==" or _wanted(part, c, seen) is None]
    values = [f"{key} = {value_text(seen.signals[key])}" for key in dict.fromkeys(told) if key in seen.signals]
    return ", ".join(values)


def _failing(part: Part, constraint: Constraint, seen: Seen) -> Failing | None:
    key, wanted = constraint.key, _wanted(part, constraint, seen)
    value = seen.signals.get(key)
    if value is None and key in seen.unread:
        return None  # another constraint is never met there
    if value is None:
        return Failing(key, constraint.op, wanted, None, "failed" if key in seen.failed else "absent")
    if isinstance(constraint.value, Ref):
        met = wanted is not None and meets(Constraint(key, "==", wanted), shortened(value))
    elif isinstance(constraint.value, Signal | Limit):
        met = precedes(value, constraint.op, wanted)
    else:
        met = meets(constraint, value) or (constraint.op == "==" and meets(constraint, shortened(value)))
    than = constraint.value.name if isinstance(constraint.value, Signal) else ""
    return None if met else Failing(key, constraint.op, wanted, value, than=than)


def _wanted(part: Part, constraint: Constraint, seen: Seen) -> Scalar | None:
    """What a constraint compares with at a step; None for any value, and for those of a variable not seen yet."""
    match constraint.value:
        case Any():
            return None
        case Ref(name) | Limit(name):
            return scalar(part.values.get(part.scope[name]))
        case Signal(name):
            return seen.signals.get(name)
        case value:
            return value
