"""Formulas in rtamt's own syntax, read by rtamt's own parser, and refused where a running monitor can't judge them.

What rtamt reads is a file, which may import Python modules. Here it is one expression, and names are signals.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from functools import reduce
from typing import Any

from antlr4 import CommonTokenStream, InputStream, Token
from antlr4.error.ErrorListener import ErrorListener
from rtamt import RTAMTException, StlDiscreteTimeOnlineSpecification
from rtamt.antlr.parser.stl.LtlLexer import LtlLexer
from rtamt.antlr.parser.stl.StlParser import StlParser

from oracle_server.core.errors import FormulaError
from oracle_server.core.formula.parse import MAX_DISTANCE, Time
from oracle_server.core.formula.tree import NANOSECONDS, And, Atom, Constraint, Exists, Formula, Position, Ref
from oracle_server.core.kinds import RESERVED
from oracle_server.engines.stl.numbers import Number, nodes, take_out

MAX_TEXT = 4096
"""Longest formula, in characters."""
_FUTURE = frozenset({
    LtlLexer.AlwaysOperator, LtlLexer.EventuallyOperator, LtlLexer.UntilOperator, LtlLexer.UnlessOperator,
    LtlLexer.NextOperator, LtlLexer.StrongNextOperator,
})  # fmt: skip
_parsing = threading.Lock()
"""The parser's tables are filled while it runs, and are everyone's."""


@dataclass(frozen=True, slots=True)
class Stl:
    """A formula: rtamt's specification, its tree, and the signals that it reads, each with its first place.

    `numbers` are the variables of the tree that stand for arithmetic.
    """

    specification: Any
    root: Any
    signals: dict[str, Position]
    numbers: dict[str, Number]

    @property
    def formula(self) -> Formula:
        """What the rest of the core sees: an atom a signal, in their order, each with the signal's value."""
        found: list[Formula] = [
            Exists(name, Atom((Constraint(name, "==", Ref(name)),), place), place)
            for name, place in self.signals.items()
        ]
        return reduce(And, found[1:], found[0])


def read_stl(text: str, time: Time) -> Stl:
    """Read a formula; raises `FormulaError` with line and column.

    Its bounds become whole numbers: samples under `steps`, nanoseconds under `seconds`.
    """
    if len(text) > MAX_TEXT:
        raise FormulaError(f"the formula has {len(text)} characters; with `engine: rtamt` at most {MAX_TEXT} are read")
    if "//" in text or "/*" in text:
        raise FormulaError("comments are not read here; YAML's `#` can stand beside the formula")
    try:
        with _parsing:
            return _read(text, time)
    except RecursionError:
        raise FormulaError("the formula is nested too deep") from None
    except (RTAMTException, ValueError, ArithmeticError) as error:
        raise FormulaError(f"rtamt can't read it: {error}") from None


def _read(text: str, time: Time) -> Stl:
    listener = _Listener()
    lexer = LtlLexer(InputStream(text))
    parser = StlParser(tokens := CommonTokenStream(lexer))
    for part in (lexer, parser):
        part.removeErrorListeners()
        part.addErrorListener(listener)
    tokens.fill()
    parsed = parser.expression()
    if parser.getCurrentToken().type != Token.EOF:
        raise _unexpected(parser.getCurrentToken())
    signals = _signals(tokens.tokens)
    _check_intervals(parsed, time)
    specification = StlDiscreteTimeOnlineSpecification()
    for name in signals:
        specification.declare_var(name, "float")
    root = specification.ast.visit(parsed)
    for node in nodes(root):
        if hasattr(node, "begin"):
            node.begin, node.end = _bounds((node.begin, node.begin_unit), (node.end, node.end_unit), time)
            node.begin_unit = node.end_unit = ""
    root, numbers = take_out(root)
    return Stl(specification, root, signals, numbers)


class _Listener(ErrorListener):  # type: ignore[misc] # has no types
    def syntaxError(self, _recognizer: Any, symbol: Any, line: int, column: int, *_rest: Any) -> None:  # noqa: N802 -- ANTLR's name
        if symbol is not None:
            raise _unexpected(symbol)
        raise FormulaError("rtamt knows no such character", line, column + 1)


def _place(token: Any) -> Position:
    return token.line, token.column + 1


def _unexpected(token: Any) -> FormulaError:
    if token.type == Token.EOF:
        return FormulaError("the formula ends too early", *_place(token))
    return FormulaError(f"{token.text!r} is not expected here", *_place(token))


def _signals(tokens: list[Any]) -> dict[str, Position]:
    found: dict[str, Position] = {}
    for token in tokens:
        if token.type in _FUTURE:
            word = f"'{token.text}' looks ahead, and a verdict is about what has happened"
            raise FormulaError(f"{word}: there are once, historically, since and prev", *_place(token))
        if token.type != LtlLexer.Identifier:
            continue
        name = token.text
        if "/" in name:
            raise FormulaError(
                f"'{name}' is one name to rtamt; write a division with spaces around `/`", *_place(token)
            )
        if "." in name:
            raise FormulaError(f"the signal '{name}' needs a name without a dot here", *_place(token))
        if name in RESERVED:
            raise FormulaError(
                f"'{name}' is every event's own; formulas of rtamt read signals of the spec", *_place(token)
            )
        found.setdefault(name, _place(token))
    if not found:
        raise FormulaError("the formula reads no signal")
    return found


def _check_intervals(parsed: Any, time: Time) -> None:
    todo = [parsed]
    while todo:
        part = todo.pop()
        todo.extend(getattr(part, "children", None) or ())
        if not isinstance(part, StlParser.IntervalContext):
            continue
        try:
            _bounds(_end(part.intervalTime(0)), _end(part.intervalTime(1)), time)
        except ValueError as error:
            raise FormulaError(str(error), *_place(part.start)) from None


def _end(part: Any) -> tuple[Fraction, str]:
    if isinstance(part, StlParser.ConstantTimeLiteralContext):
        raise ValueError("bounds are numbers")  # noqa: TRY004 -- the text is wrong, not a type
    return Fraction(Decimal(part.literal().getText())), part.unit().getText() if part.unit() else ""


def _bounds(begin: tuple[Fraction, str], end: tuple[Fraction, str], time: Time) -> tuple[int, int]:
    """Both ends as whole numbers of samples or nanoseconds; an end without a unit has the other one's."""
    lower, upper = (_distance(value, unit or other, time) for (value, unit), (_, other) in ((begin, end), (end, begin)))
    if lower > upper:
        raise ValueError("the bound ends before it begins")
    return lower, upper


def _distance(value: Fraction, unit: str, time: Time) -> int:
    if time == "steps":
        if unit:
            raise ValueError("bounds count steps, and have no unit; `time: seconds` makes them durations")
        if value.denominator != 1:
            raise ValueError("bounds count steps, and are whole numbers")
        exact = value
    else:
        exact = value * NANOSECONDS[unit or "s"]
        if exact.denominator != 1:
            raise ValueError("a bound is finer than a nanosecond")
    if exact > MAX_DISTANCE:
        raise ValueError("a bound is too large")
    return int(exact)
