"""Text to tree: `parse_formula`. What is malformed, unbound, unused or too large is refused with its place."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from functools import cache
from typing import TypeVar, cast

from lark import Lark, Token, Transformer, UnexpectedInput, v_args
from lark.exceptions import VisitError

from oracle_server.core.errors import FormulaError
from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import check_ahead
from oracle_server.core.formula.grammar import RYE
from oracle_server.core.formula.misatom import of_bare, of_value
from oracle_server.core.formula.misread import misread
from oracle_server.core.formula.names import Names, uses, written_out
from oracle_server.core.formula.relations import check_relations
from oracle_server.core.formula.tree import ALL_PAST, NANOSECONDS, UNBOUNDED, Atom, Bound, Constraint, Formula, Ref

Time = tree.Time
MAX_TEXT = 16_384
"""Longest formula, in characters."""
_VALUES = ("true", "false", "nan", "inf", "infinity", "none", "null")
"""Names that are values elsewhere, and no signals with which others are compared."""
MAX_DISTANCE = 10**18
"""Largest bound, in steps or nanoseconds (31 years)."""

_Quantifier = TypeVar("_Quantifier", tree.Exists, tree.Forall)


def parse_formula(text: str, time: Time = "steps", names: Names | None = None) -> Formula:
    """Read a formula, with the names in it written out.

    `time` decides what bounds count: judged events (`steps`, whole numbers) or nanoseconds (`seconds`, where the
    text has seconds or carries units). Raises `FormulaError` with line and column.
    """
    written = read_part(text, time, names or Names())
    check(written)
    return written


def check(formula: Formula) -> None:
    """Refuse what can't be judged as a property. Raises `FormulaError` with its place."""
    check_variables(formula)
    check_ahead(formula)
    check_relations(formula)


def read_part(text: str, time: Time, names: Names) -> Formula:
    """Read what may have variables that something around it binds. Raises `FormulaError` with line and column."""
    if len(text) > MAX_TEXT:
        raise FormulaError(f"the formula has {len(text)} characters; at most {MAX_TEXT} are read")
    try:
        parsed = cast("Formula", _parser(time).parse(text))
    except UnexpectedInput as error:
        raise misread(text, _where(error), names, time) from None
    except VisitError as error:
        if isinstance(error.orig_exc, FormulaError):
            raise error.orig_exc from None
        raise
    used = sorted(uses(parsed), key=lambda use: use.at)
    for use in used:
        if use.call.name not in names.known:
            raise misread(text, _offset(text, use.at), names, time)
    return written_out(parsed, used, names, time)


@cache
def _parser(time: Time) -> Lark:
    return Lark(RYE, parser="lalr", lexer="contextual", transformer=_Builder(time))


def _where(error: UnexpectedInput) -> int | None:
    """The character at which a formula can't be read on, None for its end."""
    ended = getattr(getattr(error, "token", None), "type", "") == "$END"
    return None if ended else error.pos_in_stream


def _offset(text: str, at: tree.Position) -> int:
    """The character at a place of the text."""
    lines = text.split("\n")
    return sum(len(line) + 1 for line in lines[: at[0] - 1]) + at[1] - 1


def check_variables(
    formula: Formula, given: frozenset[str] = frozenset(), of: tree.Call | None = None
) -> frozenset[str]:
    """The variables of a formula, that `of` a name or a property's, which nothing in it binds.

    Raises `FormulaError` where they are not `given`, and where a quantifier binds what nothing uses.
    """
    return _used(formula, given, of)


def _used(node: Formula, bound: frozenset[str], of: tree.Call | None) -> frozenset[str]:
    """The free variables of a node; refuses those that nothing binds and quantifiers that nothing uses."""
    if isinstance(node, Atom | tree.Relation):
        for name in node.variables:
            if name not in bound:
                raise FormulaError(f"the variable '{name}' is free; {_bind(name, of)}", *node.at)
        return frozenset(node.variables)
    if isinstance(node, tree.Exists | tree.Forall):
        used = _used(node.body, bound | {node.variable}, of)
        if node.variable not in used:
            raise FormulaError(
                f"the variable '{node.variable}' is bound here and used nowhere; a value is bound with a `*`, as in "
                f"`{{id: *{node.variable}}}`",
                *node.at,
            )
        return used - {node.variable}
    return frozenset().union(*(_used(child, bound, of) for child in tree.children(node)))


def _bind(name: str, of: tree.Call | None) -> str:
    """How a variable can be bound."""
    mend = f"bind it with forall[{name}]. or exists[{name}]. in front"
    if of is None:
        return mend
    return f"{mend}, or name it as a variable of its own: `{tree.Call(of.name, (*of.arguments, name))}`"


@v_args(inline=True)
class _Builder(Transformer[Token, Formula]):
    """Builds the tree bottom-up while lark parses, so that no recursion depends on the text."""

    def __init__(self, time: Time) -> None:
        super().__init__()
        self._time = time

    negate, pre = tree.Not, tree.Pre
    conjoin, disjoin, implies = tree.And, tree.Or, tree.Implies

    def once(self, _word: Token, bound: Bound | None, operand: Formula) -> Formula:
        return tree.Once(operand, bound or ALL_PAST)

    def historically(self, _word: Token, bound: Bound | None, operand: Formula) -> Formula:
        return tree.Historically(operand, bound or ALL_PAST)

    def since(self, left: Formula, _word: Token, bound: Bound | None, right: Formula) -> Formula:
        return tree.Since(left, right, bound or ALL_PAST)

    def eventually(self, word: Token, bound: Bound | None, operand: Formula) -> Formula:
        return tree.Eventually(operand, bound or UNBOUNDED, _place(word))

    def always(self, word: Token, bound: Bound | None, operand: Formula) -> Formula:
        return tree.Always(operand, bound or UNBOUNDED, _place(word))

    def until(self, left: Formula, word: Token, bound: Bound | None, right: Formula) -> Formula:
        return tree.Until(left, right, bound or UNBOUNDED, _place(word))

    def next(self, word: Token, operand: Formula) -> Formula:
        return tree.Next(operand, _place(word))

    def truth(self, word: Token) -> Formula:
        return _placed(tree.TRUE, word)

    def falsity(self, word: Token) -> Formula:
        return _placed(tree.FALSE, word)

    def first(self, word: Token) -> Formula:
        return _placed(tree.FIRST, word)

    def lasting(self, _word: Token, distance: Token, operand: Formula) -> Formula:
        return tree.lasting(operand, self._distance(distance))

    def use(self, name: Token, *arguments: Token | None) -> Formula:
        call = tree.Call(str(name), tuple(str(argument) for argument in arguments if argument is not None))
        return tree.Use(call, _place(name))  # type: ignore[return-value] # it is written out before anything sees it

    def exists(self, word: Token, *parts: object) -> Formula:
        return _quantify(tree.Exists, word, parts)

    def forall(self, word: Token, *parts: object) -> Formula:
        return _quantify(tree.Forall, word, parts)

    def both_ends(self, lower: Token, upper: Token) -> Bound:
        bound = Bound(self._distance(lower), self._distance(upper))
        if bound.upper is not None and bound.upper < bound.lower:
            raise FormulaError(f"the bound [{lower}:{upper}] is empty: {lower} is more than {upper}", *_place(lower))
        return bound

    def lower_end(self, lower: Token) -> Bound:
        return Bound(self._distance(lower), None)

    def upper_end(self, upper: Token) -> Bound:
        return Bound(0, self._distance(upper))

    def atom(self, brace: Token, *constraints: Constraint) -> Atom:
        return Atom((*constraints, *tree.demanded(constraints)), _place(brace))

    def key(self, token: Token) -> str:
        return _unquoted(token)

    def flag(self, key: str) -> Constraint:
        return Constraint(key, "==", value=True)

    def equal(self, key: str, value: tree.Scalar | tree.Any | Ref) -> Constraint:
        return _equality(key, "==", value)

    def unequal(self, key: str, value: tree.Scalar) -> Constraint:
        return _equality(key, "!=", value)

    def compare(self, key: str, op: Token, value: Token) -> Constraint:
        return Constraint(key, str(op), self.number(value))  # type: ignore[arg-type]

    def compare_signals(self, key: str, op: Token, name: Token) -> Constraint:
        if str(name).lower() in _VALUES:
            raise FormulaError(of_value(str(op), str(name)), *_place(name))
        if key == name:
            raise FormulaError(f"`{key}` is compared with itself; write the signal or the number meant", *_place(name))
        return Constraint(key, str(op), tree.Signal(str(name)))  # type: ignore[arg-type]

    def compare_limit(self, key: str, op: Token, name: Token) -> Constraint:
        return Constraint(key, str(op), tree.Limit(str(name)))  # type: ignore[arg-type]

    def relation(self, star: Token, name: Token, op: Token, other: tree.Scalar | Ref) -> Formula:
        if isinstance(other, Ref) and other.name == name:
            raise FormulaError(f"`*{name}` is compared with itself; write the other variable", *_place(star))
        return tree.Relation(Ref(str(name)), "==" if op == "=" else str(op), other, _place(star))  # type: ignore[arg-type]

    def bare(self, name: Token) -> tree.Scalar:
        raise FormulaError(of_bare(str(name)), *_place(name))

    def ref(self, name: Token) -> Ref:
        return Ref(str(name))

    def any_value(self) -> tree.Any:
        return tree.Any.ANY

    def name(self, token: Token) -> Token:
        return token

    def string(self, token: Token) -> str:
        return _unquoted(token)

    def true(self, _word: Token) -> bool:
        return True

    def false(self, _word: Token) -> bool:
        return False

    def number(self, token: Token) -> int | float:
        if len(token) > 40:
            raise FormulaError(f"the number {token[:20]}… is too long", *_place(token))
        if str(token).lstrip("-").isdigit():
            return int(token)
        value = float(token)
        if not math.isfinite(value):
            raise FormulaError(f"the number {token} is too large", *_place(token))
        return value

    def _distance(self, token: Token) -> int:
        text = str(token)
        if len(text) > 40:
            raise FormulaError(f"the bound {text[:20]}… is too long", *_place(token))
        digits = text.rstrip("abcdefghijklmnopqrstuvwxyz")
        unit = text[len(digits) :]
        if self._time == "steps":
            if unit or not digits.isdigit():
                raise FormulaError(
                    f"the bound '{text}' is not a number of steps; with `time: steps` write a whole number of judged "
                    "events, with `time: seconds` a duration",
                    *_place(token),
                )
            distance = int(digits)
        else:
            exact = Fraction(digits) * NANOSECONDS[unit or "s"]
            distance = int(exact)
            if distance != exact:
                raise FormulaError(f"the bound '{text}' is finer than a nanosecond", *_place(token))
        if distance > MAX_DISTANCE:
            raise FormulaError(f"the bound '{text}' is too large", *_place(token))
        return distance


def _quantify(kind: type[_Quantifier], word: Token, parts: tuple[object, ...]) -> Formula:
    *names, body = parts
    for name in reversed(names):
        body = kind(str(name), body, _place(word))  # type: ignore[arg-type]
    return body  # type: ignore[return-value]


def _equality(key: str, op: tree.Op, value: tree.Scalar | tree.Any | Ref) -> Constraint:
    if isinstance(value, Token):
        return Constraint(key, op, str(value), bare=True)
    return Constraint(key, op, value)


def _placed(formula: Formula, word: Token) -> Formula:
    """What a word stands for, where it stands."""
    if isinstance(formula, Atom):
        return replace(formula, at=_place(word))
    return tree.rebuilt(formula, lambda part: _placed(part, word))


def _place(token: Token) -> tree.Position:
    return (token.line or 1, token.column or 1)


def _unquoted(token: Token) -> str:
    return str(token[1:-1] if token.type == "STRING" else token)
