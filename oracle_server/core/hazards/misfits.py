"""Atoms that no value can meet, or every value does: what they compare does not fit the signal's expression."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Literal

from oracle_server.core.comparisons import contradictory
from oracle_server.core.derived.ranges import JUST_NOW
from oracle_server.core.formula.render import render_atom
from oracle_server.core.formula.tree import (
    Any,
    Atom,
    Constraint,
    Formula,
    Limit,
    Position,
    Ref,
    Scalar,
    Signal,
    demanded,
)
from oracle_server.core.hazards.places import Place, likened, names_of
from oracle_server.core.kinds import NAMING
from oracle_server.core.ranges import ANYTHING, Range
from oracle_server.core.shapes import UNIT
from oracle_server.core.signals import is_signal

Claim = Literal["never", "met", "apart", "related", "unrelated", "idle", "spanned", "true", "false"]
_FINITE = (
    "a signal is never NaN or infinite, since it then fails, and what reads it is unknown; to see it, declare a signal "
    "such as `odd: msg.x == 'NaN' || msg.x == 'Infinity'`"
)


_NUMBER = re.compile(r"-?[0-9]{1,15}(\.[0-9]{1,15})?", re.ASCII)


@dataclass(frozen=True, slots=True)
class Doubt:
    """A part of a formula that hardly means what its author meant, and a claim that holds whatever comes.

    `never`: the atom holds nowhere. `met`: its constraint is met wherever the signal is there. `apart`: it holds for
    no value for which another atom does that uses the variable. `related`, `unrelated`: it is a relation, which holds
    for all values of its variables, or for none. `idle`: the atom might as well be false. `true`,
    `false`: the part does so at every event of the places that `where` names. `spanned`: it holds wherever its signal
    is there. `key` is the property's key at which it
    is told, and `at` the place in the formula, where it is that.
    """

    claim: Claim
    part: Formula
    message: str
    at: Position
    where: tuple[str, ...] = ()
    key: Literal["formula", "guards"] = "formula"


def misfits(atom: Atom, places: Sequence[Place]) -> Iterator[Doubt]:
    """What no event can meet, or every event that has the signal does."""
    like = likened(atom, places)
    kinds = {id(p): p for p in like}
    possible = {key: p for key, p in kinds.items() if p.allows(atom) and not p.lacks(atom)}
    if not possible:
        return
    could = [p for p, first in zip(places, like, strict=True) if id(first) in possible]
    unordered = contradictory(atom.constraints)
    if unordered:
        listed = " and ".join(f"`{constraint_text(c)}`" for c in unordered)
        yield Doubt("never", atom, f"`{render_atom(atom)}` never holds: no two numbers meet {listed}", atom.at)
        return
    if all(p.misfit(atom) for p in possible.values()):
        yield Doubt("never", atom, _never(atom, could), atom.at)
        return
    for constraint in atom.constraints:
        if all(p.itself(constraint) is False for p in possible.values()):
            yield Doubt("never", atom, f"`{constraint_text(constraint)}` is never met{counted(atom, could)}", atom.at)
            return
    for constraint in atom.constraints:
        if _asks_nothing(constraint, atom, list(possible.values())):
            yield Doubt("met", atom, _always(constraint, could), atom.at)


def _asks_nothing(constraint: Constraint, atom: Atom, possible: Sequence[Place]) -> bool:
    """Whether a constraint is met by every value, though it says more than that there is one.

    The ends of an interval are well written out, even where one of them is that of the type.
    """
    key, op = constraint.key, constraint.op
    if key in NAMING or op == "==":
        return False
    if all(p.itself(constraint) for p in possible):
        return True
    interval = op != "!=" and any(c.key == key and c is not constraint for c in atom.constraints)
    return not interval and all(p.range(key).always_meets(constraint) for p in possible)


def _never(atom: Atom, could: Sequence[Place]) -> str:
    own = could[0].misfit(atom)
    shown = [f"`{constraint_text(c)}`" for c in own]
    unreal = next((c for c in own if c.op == "==" and _is_not_finite(c, range_at(c.key, could))), None)
    if unreal is not None:
        return f"`{constraint_text(unreal)}` is never met: {_FINITE}"
    if not ANYTHING.meets(own):
        if len(own) == 1:  # an order is asked of what has none
            return f"{shown[0]} is never met: only numbers are smaller or larger"
        listed = f"{', '.join(shown[:-1])} and {shown[-1]}"
        return f"`{render_atom(atom)}` never holds: no value of `{own[0].key}` meets {listed}"
    key = own[0].key
    found = range_at(key, could)
    culprit = next((c for c in own if not found.meets([c])), None)
    if culprit is None:
        listed = f"{', '.join(shown[:-1])} and {shown[-1]}"
        return f"{listed} are never met together: `{key}` of {names_of(could)} is always {described(found)}"
    text = constraint_text(culprit)
    known = (
        f"`{key}` of {names_of(could)} is always {described(found)}{_mend(culprit, found)}{begun_anew([key], could)}"
    )
    return f"`{text}` is never met: {known}"


def _is_not_finite(constraint: Constraint, found: Range) -> bool:
    """Whether a constraint asks for NaN or an infinity, of a signal that may be a number."""
    wanted = constraint.value
    if not isinstance(wanted, str) or not is_signal(wanted):
        return isinstance(wanted, str)
    named = wanted.lstrip("+-").lower() in ("nan", "inf", "infinity")
    return named and found.kinds == {"number"}


def _always(constraint: Constraint, could: Sequence[Place]) -> str:
    found = range_at(constraint.key, could)
    text = constraint_text(constraint)
    if _is_not_finite(constraint, found):
        return f"`{text}` is met by every value: {_FINITE}"
    if isinstance(constraint.value, Signal):
        return f"`{text}` is met by every value{counted(Atom((constraint,)), could)}"
    known = f"`{constraint.key}` of {names_of(could)} is always {described(found)}{_mend(constraint, found)}"
    known += begun_anew([constraint.key], could)
    return f"`{text}` is met by every value: {known}"


def begun_anew(keys: Iterable[str], could: Sequence[Place]) -> str:
    """What is said of an age that is asked for at the very events from which it counts; mostly empty."""
    for key in keys:
        if all(p.now(key) is JUST_NOW for p in could):
            return (
                f"; `{key}` begins anew with these events, and is 0 at each of them: to say how long they may stay "
                f"away, ask for it alone, as `{{{key} <= 0.5}}` with `time: seconds`"
            )
    return ""


def counted(atom: Atom, could: Sequence[Place]) -> str:
    """What is said of a signal beside the last, least or largest of its samples, one of which it is; mostly empty."""
    keys = {c.key for c in atom.constraints} | {c.value.name for c in atom.constraints if isinstance(c.value, Signal)}
    for name, found in {name: found for place in could for name, found in place.again.items()}.items():
        if name in keys and found.of in keys:
            is_ = {"last": "is", "max": "is never less than", "min": "is never more than"}[found.op]
            alone = f", if one monitor alone sends {found.of}" if any(_keeps(p, found.of) for p in could) else ""
            before = f"; the sample before is `previous: {found.of}`, and how far both are apart `delta: {found.of}`"
            return (
                f"; `{found.op}: {found.of}` counts the very event, so that `{name}` {is_} `{found.of}` wherever both "
                f"are there{alone}{before if found.op == 'last' else ''}"
            )
    return ""


def _keeps(place: Place, name: str) -> bool:
    """Whether events have a signal by what is held alone, for each monitor by itself."""
    return name in place.held and not (place.stream is not None and name in place.stream.hold)


def range_at(key: str, could: Sequence[Place]) -> Range:
    """The values that a signal can have at some places."""
    found = Range()
    for place in could:
        found |= place.range(key)
    return found


def described(found: Range) -> str:
    """The values in words, as in "it is always …"."""
    words = {"text": "a text", "number": _numbers(*found.limits), "boolean": "true or false"}
    besides = replace(found, values=())
    values = [v for v in found.values if not besides.meets([Constraint("", "==", v)])]
    parts = [*(_literal(v) for v in values[:8]), *(words[kind] for kind in sorted(found.kinds))]
    if found.whole is not None:
        least, most = found.whole
        short = least >= -(2**31) and most < 2**32
        open_ = "" if least < 0 else f" from {least} on" if least else " that is not negative"
        ends = f" from {least} to {most}" if short else open_
        parts.append(f"a whole number{ends}")
    return " or ".join(parts) or "absent"


def _numbers(least: float, most: float) -> str:
    if isfinite(least) and isfinite(most):
        return f"a number from {least} to {most}"
    if isfinite(least):
        return f"a number of at least {least}" if least else "a number that is not negative"
    return f"a number of at most {most}" if isfinite(most) else "a number"


def _mend(constraint: Constraint, found: Range) -> str:
    """What to write instead, where that is near."""
    wanted = constraint.value
    if isinstance(wanted, Any | Ref | Signal | Limit):
        return ""
    key, op = constraint.key, ":" if constraint.op == "==" else f" {constraint.op}"
    numbers = found.has_numbers
    if constraint.op not in ("==", "!="):
        return _mend_order(found)
    near = _near(wanted, found)
    if near is not None:
        return f"; write `{key}{op} {_literal(near)}`"
    if numbers and isinstance(wanted, bool):
        return f"; write a comparison, as in `{key}{' > 0' if wanted is (constraint.op == '==') else ': 0'}`"
    if numbers and isinstance(wanted, str):
        return f"; {_literal(wanted)} is a text: write the number that it stands for"
    return ""


def _mend_order(found: Range) -> str:
    if found.limits == UNIT:
        return "; a part of a quaternion is no angle: the cookbook has tilt and heading"
    return "" if found.has_numbers else "; texts and Booleans are neither smaller nor larger than a number"


def _near(wanted: Scalar, found: Range) -> Scalar | None:
    """A value that the signal can have, and that is written much like the wanted one."""
    text = _plain(wanted)
    alike = {_plain(v): v for v in found.values}
    if "boolean" in found.kinds:
        alike |= {"true": True, "false": False, "1": True, "0": False}
    if isinstance(wanted, str) and _NUMBER.fullmatch(text):
        number = float(text) if "." in text else int(text)
        if found.meets([Constraint("", "==", number)]):
            return number
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
    return render_atom(Atom((constraint, *demanded((constraint,)))))[1:-1]
