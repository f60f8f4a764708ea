"""A property module as signals of streams and a formula over them, which says at each event what its oracle said.

A predicate that a message does not set keeps its value. Where all messages but one stream's leave it alone, that
stream holds it; where a message sets it only at times, or several streams do, the formula looks back itself: `p` is
then `not {p: false} since {p}`.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from oracle_server.core.errors import ExpressionError, one_line
from oracle_server.core.expression import parse_expression
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import (
    And,
    Atom,
    Constraint,
    Exists,
    Forall,
    Formula,
    Historically,
    Not,
    Once,
    Ref,
    Scalar,
    Since,
    atoms,
    walk,
)
from oracle_server.core.formula.tree import Any as AnyValue
from oracle_server.specfiles.rosmonitoring.cel import Use, fitted, rendered
from oracle_server.specfiles.rosmonitoring.formulas import UnreadableFormulaError, changed, read_formula
from oracle_server.specfiles.rosmonitoring.module import PropertyModule
from oracle_server.specfiles.rosmonitoring.predicates import Predicate, follow
from oracle_server.specfiles.rosmonitoring.streams import Stream
from oracle_server.specfiles.rosmonitoring.values import Const, Kept, Raises, Term, Unread, UntranslatableError, leaves

_CONTRARY: dict[str, Any] = {"==": "!=", "!=": "==", "<": ">=", ">=": "<", ">": "<=", "<=": ">"}
_WORK: dict[str, Callable[[Any, Any], bool]] = {
    "==": operator.eq, "!=": operator.ne, "<": operator.lt, ">=": operator.ge, ">": operator.gt, "<=": operator.le,
}  # fmt: skip


@dataclass(slots=True)
class Signal:
    """A predicate's expression by stream, the streams that hold it, and the Python of those that can't be read."""

    cel: dict[Stream, str] = field(default_factory=dict)
    hold: Stream | None = None
    unread: dict[Stream, str] = field(default_factory=dict)


@dataclass(slots=True)
class Translation:
    """A module's formula and signals; `reason` is why the formula can't be judged, and `formula` None there."""

    module: PropertyModule
    formula: Formula | None = None
    signals: dict[str, Signal] = field(default_factory=dict)
    reason: str | None = None

    @property
    def text(self) -> str | None:
        """The formula as Rye, None where it can't be judged."""
        return None if self.formula is None else render(self.formula)


def translate(module: PropertyModule, streams: Sequence[Stream]) -> Translation:
    """Translate a module for some streams. Raises `FutureError` where the formula is about what comes."""
    found = Translation(module)
    try:
        formula = read_formula(module.formula)
        names = {c.key for atom in atoms(formula) for c in atom.constraints}
        known = follow(module, streams, names)
        _check(known, formula)
        uses = {name: _use(name, known[name], formula) for name in names}
        for name, predicate in known.items():
            found.signals[name] = _signal(predicate, uses[name], streams)
        found.formula = changed(formula, lambda atom: _atom(atom, known, uses, found.signals))
    except UnreadableFormulaError as error:
        found.reason, found.signals = str(error), {}
    return found


def _check(known: dict[str, Predicate], formula: Formula) -> None:
    nodes = list(walk(formula))
    if any(isinstance(n, Exists | Forall) for n in nodes) and any(
        isinstance(n, Historically) and n.bound.lower for n in nodes
    ):
        raise UnreadableFormulaError("reelay fails at the first steps of a quantified `historically[a:b]` with a > 0")
    for name, predicate in known.items():
        if name == "time":
            raise UnreadableFormulaError("it reads `time`, the seconds since the first event, which is no signal here")
        if predicate.keeping == "always" and predicate.initial is None:
            raise UnreadableFormulaError(f"nothing sets `{name}`, so that each constraint on it was false there")


def _use(name: str, predicate: Predicate, formula: Formula) -> Use:
    """What a formula compares a predicate with. Raises `UnreadableFormulaError` where that differs."""
    values = [c.value for atom in atoms(formula) for c in atom.constraints if c.key == name]
    if any(isinstance(v, AnyValue) for v in values):
        raise UnreadableFormulaError(f"`{name}: *` asks whether a message has `{name}`, which was kept there")
    if any(isinstance(v, Ref) for v in values):
        return "any"
    uses = {_kind(v) for v in values if isinstance(v, str | bool | int | float)}
    if uses == {"text"} and set(values) <= {"True", "False"} and _is_boolean(predicate):
        return "bool"
    if len(uses) != 1:
        raise UnreadableFormulaError(f"it compares `{name}` with values of several types")
    return uses.pop()


def _kind(value: Scalar) -> Use:
    if isinstance(value, bool):
        return "bool"
    return "text" if isinstance(value, str) else "number"


def _is_boolean(predicate: Predicate) -> bool:
    found = [leaf for value in predicate.by_stream.values() for leaf in leaves(value)]
    found += [] if predicate.initial is None else leaves(predicate.initial)
    return not any((isinstance(leaf, Const) and isinstance(leaf.value, str)) or
                   (isinstance(leaf, Term) and leaf.kind == "text") for leaf in found)  # fmt: skip


def _signal(predicate: Predicate, use: Use, streams: Sequence[Stream]) -> Signal:
    signal = Signal(unread=dict(predicate.unread))
    keeping = predicate.keeping
    for stream in streams:
        if stream in signal.unread:
            continue
        try:
            value = predicate.by_stream[stream]
            if keeping == "always" and predicate.initial is not None:
                signal.cel[stream] = _checked(rendered(fitted(predicate.initial, use)))
                continue
            text = _checked(rendered(fitted(value, use)))
            if text != "null":
                signal.cel[stream] = text
        except UntranslatableError:
            signal.unread[stream] = f"predicates['{predicate.name}'], of {stream.name}"
    if signal.unread:
        signal.unread = {s: signal.unread.get(s, "") for s in streams}
        signal.cel = {}
    elif keeping == "one":
        signal.hold = next(iter(signal.cel), None)
    return signal


def _checked(cel: str) -> str:
    if cel == "null":
        return cel
    try:
        parse_expression(cel)
    except ExpressionError:
        raise UntranslatableError from None
    return cel


def _atom(atom: Atom, known: dict[str, Predicate], uses: dict[str, Use], signals: dict[str, Signal]) -> Formula:
    """An atom, with its constraints on predicates that are kept looked up in what came before."""
    plain: list[Constraint] = []
    parts: list[Formula] = []
    for constraint in atom.constraints:
        mended = _typed(constraint, uses[constraint.key])
        found = mended if signals[mended.key].unread else _kept(mended, known[mended.key], uses[mended.key])
        if isinstance(found, Constraint):
            plain.append(found)
        else:
            parts.append(found)
    if plain:
        parts.insert(0, Atom(tuple(plain), atom.at))
    whole = parts[0]
    for part in parts[1:]:
        whole = And(whole, part)
    return whole


def _typed(constraint: Constraint, use: Use) -> Constraint:
    if use == "bool" and isinstance(constraint.value, str):
        return Constraint(constraint.key, constraint.op, constraint.value == "True")
    return constraint


def _kept(constraint: Constraint, predicate: Predicate, use: Use) -> Constraint | Formula:
    keeping = predicate.keeping
    if keeping in ("never", "always"):
        return constraint
    value = constraint.value
    if isinstance(value, Ref | AnyValue):
        if keeping == "one" and predicate.initial is None:
            return constraint
        raise UnreadableFormulaError(f"the variable of `{constraint.key}` is bound to a value that was kept there")
    contrary = _contrary(constraint)
    true_before = predicate.initial is not None and _holds(predicate.initial, constraint, use)
    if keeping == "one":
        return Not(Atom((contrary,))) if true_before else constraint
    asked, other = (contrary, constraint) if true_before else (constraint, contrary)
    found = Since(Not(Atom((other,))), Atom((asked,))) if _can_meet(predicate, other, use) else Once(Atom((asked,)))
    return Not(found) if true_before else found


def _can_meet(predicate: Predicate, constraint: Constraint, use: Use) -> bool:
    """Whether some message may set a predicate to a value that meets a constraint."""
    values = [leaf for value in predicate.by_stream.values() for leaf in leaves(fitted(value, use))]
    return any(
        not isinstance(leaf, Kept | Raises)
        and not (isinstance(leaf, Const) and not _WORK[constraint.op](leaf.value, constraint.value))
        for leaf in values
    )


def _contrary(constraint: Constraint) -> Constraint:
    if isinstance(constraint.value, bool) and constraint.op == "==":
        return Constraint(constraint.key, "==", not constraint.value)
    return Constraint(constraint.key, _CONTRARY[constraint.op], constraint.value)


def _holds(initial: object, constraint: Constraint, use: Use) -> bool:
    try:
        found = fitted(initial, use)  # type: ignore[arg-type]
    except UntranslatableError:
        found = Unread("")
    if isinstance(found, Const):
        return _WORK[constraint.op](found.value, constraint.value)
    why = "fails" if isinstance(found, Raises) else "can't be read"
    raise UnreadableFormulaError(f"the value of `{constraint.key}` before the first message {why}")


def reason_line(translation: Translation) -> str:
    """Why a formula can't be judged, and what it was, in one line."""
    return one_line(f"{translation.reason}; it was: {translation.module.formula}")
