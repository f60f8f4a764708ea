"""Tree to text: what `render` prints parses to the same tree, with no more parentheses than a reader needs."""

from __future__ import annotations

from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import PAST
from oracle_server.core.formula.ahead import WORDS as AHEAD
from oracle_server.core.formula.tree import (
    Always,
    And,
    Any,
    Atom,
    Bound,
    Constraint,
    Eventually,
    Exists,
    Forall,
    Formula,
    Historically,
    Implies,
    Limit,
    Next,
    Not,
    Once,
    Or,
    Pre,
    Ref,
    Relation,
    Scalar,
    Signal,
    Since,
    Time,
    Until,
)
from oracle_server.core.units import span

_WORDS: dict[type[Formula], str] = {Not: "not", **PAST, **AHEAD}
_LOOSEST, _IMPLIES, _OR, _AND, _SINCE, _UNARY = range(6)


def render(formula: Formula, time: Time = "steps", *, named: bool = False) -> str:
    """The formula as Rye text; bounds are printed in the unit that `time` reads.

    `named`: names of `define:` stand below it where its author wrote them; else all is written out.
    """
    return _Printer(time, named).text(formula)


def render_value(value: Scalar) -> str:
    """A value as Rye text."""
    return _value(value)


def render_atom(atom: Atom) -> str:
    """An atom as Rye text."""
    if not atom.constraints:
        return "true"
    return "{" + ", ".join(_constraint(c) for c in _said(atom.constraints)) + "}"


def _leaf(node: Atom | Relation) -> str:
    if isinstance(node, Relation):
        return f"{_value(node.left)} {node.op} {_value(node.right)}"
    return render_atom(node)


def head(formula: Formula, time: Time = "steps") -> str:  # noqa: C901, PLR0911 -- a case a node
    """What a part says by itself, without its own parts: an operator with its bound, an atom, a relation or a word."""
    lasted, word = tree.lasted(formula), tree.word_of(formula)
    if word is not None:
        return word
    if lasted is not None:
        return f"lasting[{_distance(lasted[1], time)}]"
    match formula:
        case Atom() | Relation():
            return _leaf(formula)
        case Exists(variable) | Forall(variable):
            return f"{'exists' if isinstance(formula, Exists) else 'forall'}[{variable}]."
        case And():
            return "and"
        case Or():
            return "or"
        case Implies():
            return "->"
        case Not() | Pre() | Next():
            return _WORDS[type(formula)]
        case Once(_, bound) | Historically(_, bound) | Eventually(_, bound) | Always(_, bound):
            return _WORDS[type(formula)] + _bound(bound, time)
        case Since(_, _, bound) | Until(_, _, bound):
            return _WORDS[type(formula)] + _bound(bound, time)


class _Printer:
    """Prints with or without names."""

    def __init__(self, time: Time, named: bool) -> None:
        self._time, self._named = time, named

    def text(self, node: Formula, tightness: int = _LOOSEST) -> str:
        """A node where it stands, with its name left out."""
        own, text = self._short(node) or self._operator(node)
        return f"({text})" if own < tightness else text

    def _part(self, node: Formula, tightness: int) -> str:
        return str(node.written) if self._named and node.written else self.text(node, tightness)

    def _short(self, node: Formula) -> tuple[int, str] | None:
        """A formula for which there is a word of its own; None for any other."""
        lasted, word = tree.lasted(node), tree.word_of(node)
        if lasted is not None:
            return _UNARY, f"lasting[{_distance(lasted[1], self._time)}] {self._part(lasted[0], _UNARY)}"
        return None if word is None else (_UNARY, word)

    def _operator(self, node: Formula) -> tuple[int, str]:  # noqa: PLR0911 -- a case a node
        """How tightly a node binds, and its text."""
        match node:
            case Atom() | Relation():
                return _UNARY, _leaf(node)
            case Not(operand) | Pre(operand) | Next(operand):
                return _UNARY, f"{_WORDS[type(node)]} {self._part(operand, _UNARY)}"
            case (
                Once(operand, bound)
                | Historically(operand, bound)
                | Eventually(operand, bound)
                | Always(operand, bound)
            ):
                return _UNARY, f"{_WORDS[type(node)]}{_bound(bound, self._time)} {self._part(operand, _UNARY)}"
            case Since(left, right, bound) | Until(left, right, bound):
                word = f"{_WORDS[type(node)]}{_bound(bound, self._time)}"
                return _SINCE, f"{self._part(left, _SINCE)} {word} {self._part(right, _UNARY)}"
            case And(left, right):
                return _AND, f"{self._part(left, _AND)} and {self._part(right, _SINCE)}"
            case Or(left, right):
                return _OR, f"{self._part(left, _OR)} or {self._part(right, _AND)}"
            case Implies(left, right):
                return _IMPLIES, f"{self._part(left, _OR)} -> {self._part(right, _IMPLIES)}"
            case Exists(variable, body):
                return _LOOSEST, f"exists[{variable}]. {self._part(body, _LOOSEST)}"
            case Forall(variable, body):
                return _LOOSEST, f"forall[{variable}]. {self._part(body, _LOOSEST)}"


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


def _value(value: Scalar | Any | Ref | Signal | Limit) -> str:
    match value:
        case Any():
            return "*"
        case Ref(name) | Limit(name):
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
