"""Reads predicates of HPL, which stand in braces behind a topic."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from oracle_server.specfiles.hpl.scan import Scanner
from oracle_server.specfiles.hpl.tree import (
    Binary,
    Call,
    Constant,
    Expr,
    Group,
    Number,
    Quantified,
    Range,
    Reference,
    Text,
    Truth,
    Unary,
)

WORDS = frozenset(("not", "and", "or", "implies", "iff", "in", "to", "forall", "exists"))
"""What can't be a field's name where a value is expected."""
CONSTANTS = ("PI", "INF", "NAN", "E")
MOST_NESTED = 30
MOST_OPERATORS = 200
_RELATIONS = ("!=", "<=", ">=", "=", "<", ">")


def read_predicate(scanner: Scanner) -> Expr:
    """The condition between braces. Raises `HplError`."""
    scanner.sign("{")
    found = _Predicate(scanner).condition()
    if not scanner.sign("}"):
        scanner.refuse("a predicate ends with `}`: an operator, as `and`, or `}` is expected")
    return found


@dataclass(slots=True)
class _Predicate:
    scanner: Scanner
    depth: int = 0
    operators: int = 0

    def condition(self) -> Expr:
        return self._nested(lambda: self._joined(self._disjunction, "implies", "iff"))

    def _disjunction(self) -> Expr:
        return self._joined(self._conjunction, "or")

    def _conjunction(self) -> Expr:
        return self._joined(self._logic, "and")

    def _joined(self, operand: Callable[[], Expr], *words: str) -> Expr:
        at = self.scanner.at
        found = operand()
        while word := self.scanner.word(*words):
            found = self._binary(at, word, found, operand())
        return found

    def _binary(self, at: int, sign: str, left: Expr, right: Expr) -> Expr:
        self.operators += 1
        if self.operators > MOST_OPERATORS:
            self.scanner.refuse(f"a predicate has at most {MOST_OPERATORS} operators", at)
        return Binary(at, self.scanner.end, sign, left, right)

    def _logic(self) -> Expr:
        at = self.scanner.at
        if self.scanner.word("not"):
            operand = self._nested(self._logic)
            return Unary(at, self.scanner.end, "not", operand)
        if word := self.scanner.word("forall", "exists"):
            return self._nested(lambda: self._quantified(at, word))
        found = self._sum()
        sign = self.scanner.sign(*_RELATIONS) or self.scanner.word("in")
        return self._binary(at, sign, found, self._sum()) if sign else found

    def _nested(self, read: Callable[[], Expr]) -> Expr:
        self.depth += 1
        if self.depth > MOST_NESTED:
            self.scanner.refuse(f"at most {MOST_NESTED} parts within each other are read")
        found = read()
        self.depth -= 1
        return found

    def _quantified(self, at: int, word: str) -> Expr:
        variable = self.scanner.name() or self.scanner.refuse(f"a variable's name stands behind `{word}`")
        if not self.scanner.word("in"):
            self.scanner.refuse(f"`in` is expected, as in `{word} {variable} in array: @{variable} > 0`")
        domain = self._value()
        if not self.scanner.sign(":"):
            self.scanner.refuse("`:` stands between what a variable runs over, and what is said of it")
        body = self._logic()
        return Quantified(at, self.scanner.end, word, variable, domain, body)

    def _sum(self) -> Expr:
        at = self.scanner.at
        found = self._term()
        while sign := self.scanner.sign("+", "-"):
            found = self._binary(at, sign, found, self._term())
        return found

    def _term(self) -> Expr:
        at = self.scanner.at
        found = self._factor()
        while not self._is("**") and (sign := self.scanner.sign("*", "/")):
            found = self._binary(at, sign, found, self._factor())
        return found

    def _factor(self) -> Expr:
        at = self.scanner.at
        found = self._value()
        while self.scanner.sign("**"):
            found = self._binary(at, "**", found, self._value())
        return found

    def _is(self, sign: str) -> bool:
        return self.scanner.text.startswith(sign, self.scanner.at)

    def _value(self) -> Expr:
        scanner, at = self.scanner, self.scanner.at
        if scanner.sign("-"):
            operand = self._nested(self._value)
            return Unary(at, scanner.end, "-", operand)
        if scanner.sign("("):
            found = self.condition()
            if not scanner.sign(")"):
                scanner.refuse("a `)` is missing")
            return found
        if scanner.sign("{"):
            items = self._listed("}")
            return Group(at, scanner.end, items)
        if sign := scanner.sign("![", "["):
            return self._nested(lambda: self._range(at, sign == "!["))
        return self._literal(at) or self._named(at)

    def _literal(self, at: int) -> Expr | None:
        scanner = self.scanner
        if (number := scanner.number()) is not None:
            return Number(at, scanner.end, number)
        if (text := scanner.string()) is not None:
            return Text(at, scanner.end, text)
        if word := scanner.word("True", "False"):
            return Truth(at, scanner.end, word == "True")
        if word := scanner.word(*CONSTANTS):
            return Constant(at, scanner.end, word)
        return None

    def _range(self, at: int, above: bool) -> Expr:
        low = self._sum()
        if not self.scanner.word("to"):
            self.scanner.refuse("`to` is expected, as in `[0 to 10]`")
        high = self._sum()
        closed = self.scanner.sign("]!", "]") or self.scanner.refuse("a range ends with `]`, or with `]!`")
        return Range(at, self.scanner.end, low, high, above, closed == "]!")

    def _listed(self, closing: str) -> tuple[Expr, ...]:
        found = [self._item()]
        while self.scanner.sign(","):
            found.append(self._item())
        if not self.scanner.sign(closing):
            self.scanner.refuse(f"`,` or `{closing}` is expected")
        return tuple(found)

    def _item(self) -> Expr:
        return self._nested(self._sum)

    def _named(self, at: int) -> Expr:
        scanner = self.scanner
        alias = ""
        steps: list[str | Expr] = []
        if scanner.sign("@"):
            alias = scanner.name() or scanner.refuse("the name of a message stands behind `@`")
        else:
            word = scanner.peek()
            if not word or word in WORDS:
                scanner.refuse("a value is expected, such as a field, a number or a text in quotes")
            scanner.name()
            if scanner.sign("("):
                arguments = self._listed(")")
                return Call(at, scanner.end, word, arguments)
            steps.append(word)
        while True:
            if scanner.sign("."):
                steps.append(scanner.name() or scanner.refuse("a field's name stands behind `.`"))
            elif not self._is("]") and scanner.sign("["):
                steps.append(self._item())
                if not scanner.sign("]"):
                    scanner.refuse("an index ends with `]`")
            else:
                return Reference(at, scanner.end, alias, tuple(steps))
