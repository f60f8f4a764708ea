"""Tree to text: what `render` prints parses to the same tree, with no more parentheses than a reader needs."""

from __future__ import annotations

from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.tree import (
    And,
    Any,
    Atom,
    Bound,
    Constraint,
    Exists,
    Forall,
    Formula,
    Historically,
    Implies,
    Not,
    Once,
    Or,
    Pre,
    Ref,
    Scalar,
    Signal,
    Since,
)
from oracle_server.core.units import span

_LOOSEST, _IMPLIES, _OR, _AND, _SINCE, _UNARY = range(6)


def render(formula: Formula, time: Time = "steps") -> str:
    """The formula as Rye text; bounds are printed in the unit that `time` reads."""
    return _render(formula, _LOOSEST, time)


def render_atom(atom: Atom) -> str:
    """An atom as Rye text."""
    if not atom.constraints:
        return "true"
    return "{" + ", ".join(_constraint(c) for c in _said(atom.constraints)) + "}"


def _render(node: Formula, tightness: int, time: Time) -> str:  # noqa: C901 -- a case a node
    own, short = _UNARY, _short(node, time)
    if short is not None:
        return short
    match node:
        case Atom():
            text = render_atom(node)
        case Not(operand):
            text = f"not {_render(operand, _UNARY, time)}"
        case Pre(operand):
            text = f"pre {_render(operand, _UNARY, time)}"
        case Once(operand, bound):
            text = f"once{_bound(bound, time)} {_render(operand, _UNARY, time)}"
        case Historically(operand, bound):
            text = f"historically{_bound(bound, time)} {_render(operand, _UNARY, time)}"
        case Since(left, right, bound):
            own = _SINCE
            text = f"{_render(left, _SINCE, time)} since{_bound(bound, time)} {_render(right, _UNARY, time)}"
        case And(left, right):
            own = _AND
            text = f"{_render(left, _AND, time)} and {_render(right, _SINCE, time)}"
        case Or(left, right):
            own = _OR
            text = f"{_render(left, _OR, time)} or {_render(right, _AND, time)}"
        case Implies(left, right):
            own = _IMPLIES
            text = f"{_render(left, _OR, time)} -> {_render(right, _IMPLIES, time)}"
        case Exists(variable, body):
            own = _LOOSEST
            text = f"exists[{variable}]. {_render(body, _LOOSEST, time)}"
        case Forall(variable, body):
            own = _LOOSEST
            text = f"forall[{variable}]. {_render(body, _LOOSEST, time)}"
    return f"({text})" if own < tightness else text


def _short(node: Formula, time: Time) -> str | None:
    """A formula for which there is a word of its own, as Rye text; None for any other."""
    lasted = tree.lasted(node)
    if lasted is not None:
        return f"lasting[{_distance(lasted[1], time)}] {_render(lasted[0], _UNARY, time)}"
    return tree.word_of(node)


def _bound(bound: Bound, time: Time) -> str:
    lower, upper = (None if d is None else _distance(d, time) for d in (bound.lower, bound.upper))
    if bound.lower == 0:
        return "" if upper is None else f"[:{upper}]"
    return f"[{lower}:{upper or ''}]"


def _distance(distance: int, time: Time) -> str:
    return str(distance) if time == "steps" else span(distance)


def _said(constraints: tuple[Constraint, ...]) -> tuple[Constraint, ...]:
    """The constraints without those at their end that the others demand."""
    whole = range(len(constraints))
    return next((constraints[:n] for n in whole if tree.demanded(constraints[:n]) == constraints[n:]), constraints)


def _constraint(constraint: Constraint) -> str:
    key = constraint.key if _is_name(constraint.key) else _quoted(constraint.key)
    if constraint.op != "==":
        return f"{key} {constraint.op} {_value(constraint.value)}"
    if constraint.value is True:
        return key
    return f"{key}: {_value(constraint.value)}"


def _value(value: Scalar | Any | Ref | Signal) -> str:
    match value:
        case Any():
            return "*"
        case Ref(name):
            return f"*{name}"
        case Signal(name):
            return name
        case bool():
            return "true" if value else "false"
        case str():
            return _quoted(value)
        case _:
            return repr(value)


def _quoted(text: str) -> str:
    return f"'{text}'" if '"' in text else f'"{text}"'


def _is_name(text: str) -> bool:
    return text.isidentifier() and text.isascii()
