"""What can be said of an expression before any message: for messages of a known shape, or whatever they are."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

from oracle_server.core.expression import operands, settled, times, tree
from oracle_server.core.expression.checkcalls import called
from oracle_server.core.expression.expression import Expression
from oracle_server.core.expression.joint import Joint
from oracle_server.core.expression.operands import Operand
from oracle_server.core.expression.spans import Spans
from oracle_server.core.expression.static import (
    BOOL,
    TEXT,
    WHOLE,
    Elements,
    Static,
    common,
    described,
    element,
    is_number,
    kind,
    no_field,
    not_single,
    result_of,
    static_of,
    written,
)
from oracle_server.core.expression.tokens import comments, place
from oracle_server.core.expression.tree import Node
from oracle_server.core.shapes import Many, Record, Shape, Value, ValueKind

Severity = Literal["error", "warning"]


@dataclass(frozen=True, slots=True)
class Problem:
    """Something wrong with an expression; `within` is the line and column in its text, from 1."""

    message: str
    within: tuple[int, int]
    severity: Severity = "error"


def check_shape(expression: Expression, shape: Shape | None) -> list[Problem]:
    """What is wrong with an expression over messages of a shape, or over any messages (None), in the text's order.

    An *error* is what makes the signal fail at every message, or the same whatever the message has; a *warning* is
    what may well be meant otherwise.
    """
    checker = _Checker(expression, shape)
    checker.result(expression.tree, checker.of(expression.tree))
    checker.comments()
    return sorted(checker.problems, key=lambda p: p.within)


def result_kind(expression: Expression, shape: Shape | None) -> ValueKind | None:
    """The kind of an expression's value over messages of a shape, None where it is not known or no single value."""
    return kind(_Checker(expression, shape).of(expression.tree))


def known(expression: Expression, node: Node, shape: Shape | None) -> Operand:
    """What is known of the value of a part that stands in no comprehension, over messages of a shape."""
    return _Checker(expression, shape).operand(node)


def check_rows(each: Expression, shape: Shape | None) -> list[Problem]:
    """What is wrong with an expression that is to be a list, over messages of a shape or over any (None)."""
    checker = _Checker(each, shape)
    static = checker.of(each.tree)
    whole = isinstance(each.tree, tree.Path) and not each.tree.names
    if whole or isinstance(static, Value | Record):
        found = "the whole message" if whole else described(static)
        message = f"`{each.text}` is {found}, and rows are the elements of a list, as in msg.transforms"
        checker.problems.append(Problem(message, place(each.text, each.tree.start)))
    checker.comments()
    return sorted(checker.problems, key=lambda p: p.within)


def _row(each: Expression, shape: Shape | None) -> list[tuple[str, Static, bool]]:
    """What is known of a row's element and place, in the order of `ROW`, and whether they are read from the message."""
    return [("item", element(known(each, each.tree, shape).static), True), ("index", WHOLE, False)]


class _Checker:
    def __init__(self, expression: Expression, shape: Shape | None) -> None:
        self.problems: list[Problem] = []
        self._expression, self._text, self._shape = expression, expression.text, shape
        self._variables: list[tuple[str, Static, bool]] = (
            [] if expression.each is None else _row(expression.each, shape)
        )
        """The variables of rows and of comprehensions around, what is known of each, and whether it is one of the
        message."""
        self._known: dict[int, Static] = {}
        """What was found of each part, by its identity."""
        self._shares: set[int] = set()
        """The operands of `%`, by their identity: whole numbers, whatever is divided in them."""
        self._ends: dict[int, bool] = {}
        """The orders that are the ends of an interval, by their identity, with what they may well always come to."""
        self._guards: dict[int, tuple[bool, ...]] = {}
        """The same of what is asked before something else is read, where that is the length of a list."""
        self._spans = Spans(lambda node: self._known.get(id(node)))
        self._joint = Joint(self._spans)
        self._rules: dict[type, Callable[[Any], Static]] = {
            tree.Literal: lambda node: written(node.value),
            tree.Path: self._path,
            tree.Variable: self._variable,
            tree.Field: lambda node: self._member(self.of(node.of), node.name, node.place, self._snippet(node.of)),
            tree.Index: self._index,
            tree.Unary: self._unary,
            tree.Chain: self._chain,
            tree.Compare: self._compare,
            tree.Joined: self._joined,
            tree.Choice: self._choice,
            tree.Call: self._call,
            tree.Has: self._has,
            tree.Loop: self._loop,
            tree.ListOf: self._list,
            tree.MapOf: self._map,
        }

    def of(self, node: Node) -> Static:
        """What is known of the value of a part."""
        self._known[id(node)] = self._rules[type(node)](node)
        return self._known[id(node)]

    def result(self, node: Node, static: Static) -> None:
        """Refuse a value that can be no signal."""
        text = self._snippet(node)
        wanted = "and a signal is one text, Boolean or number"
        match static:
            case Many() | Elements():
                mend = f"write `{text}[0]`, `size({text})` or `{text}.exists(x, x == 1)`"
                self._error(node.start, f"`{text}` is {described(static)}, {wanted}; {mend}")
            case Record(fields=fields):
                mend = times.single(text, fields) if fields else "it has no fields"
                self._error(node.start, f"`{text}` is {described(static)}, {wanted}; {mend}")
            case None if isinstance(node, tree.Path) and not node.names:
                self._error(node.start, f"`msg` is the whole message, {wanted}; write a field, as in msg.data")
            case None if isinstance(node, tree.Choice):
                for part in (*(value for _, value in node.cases), node.otherwise):
                    self.result(part, _Checker(self._expression, self._shape).of(part))

    def comments(self) -> None:
        """Warn of what looks like a part of the expression and is a comment."""
        for at, told in comments(self._text):
            if re.match(r"[\d.(]|msg\b", told):
                hint = "`//` begins a comment, so that what follows is not read; a division is written `/`"
                self._warn(at, hint)

    def _path(self, node: tree.Path) -> Static:
        static: Static = static_of(self._shape)
        for i, (name, at) in enumerate(zip(node.names, node.places, strict=True)):
            static = self._member(static, name, at, ".".join(("msg", *node.names[:i])))
        return static

    def _member(self, static: Static, name: str, at: int, text: str) -> Static:
        match static:
            case Record(fields=fields):
                if name in fields:
                    found = fields[name]
                    if not (isinstance(found, Value) and found.may_be_list):
                        return static_of(found)
                    both = "is a list of signed numbers on ROS 1, and a text in base64 on ROS 2"
                    self._warn(at, f"`{text}.{name}` {both}; `check --ros` tells whether it is read as it is there")
                    return None
                self._error(at, no_field(static, name))
            case Many() | Elements():
                mend = f"write `{text}[0].{name}` or `{text}.exists(x, x.{name} == 1)`"
                if isinstance(element(static), Value):
                    mend = f"its elements are counted by number from 0, as in `{text}[0]`"
                if name in ("size", "length", "len"):
                    mend = f"write `size({text})`"
                self._error(at, f"`{text}` is {described(static)}, and has no field `{name}`; {mend}")
            case Value():
                self._error(at, f"`{text}` is {described(static)}, and has no field `{name}`")
        return None

    def _variable(self, node: tree.Variable) -> Static:
        return next(static for name, static, _ in reversed(self._variables) if name == node.name)

    def _index(self, node: tree.Index) -> Static:
        whole, at, text = self.of(node.of), self.of(node.index), self._snippet(node.of)
        index = node.index.value if isinstance(node.index, tree.Literal) else None
        if isinstance(node.of, tree.Path) and not node.of.names and kind(at) == "whole":
            self._error(node.index.start, "`msg` is a message, and no list; write a field, as in msg.data")
        elif isinstance(whole, Value) or (isinstance(whole, Record) and is_number(at)):
            self._error(node.index.start, f"`{text}` is {described(whole)}, and no list{not_single(whole, text)}")
        elif isinstance(at, Value) and at.kind in ("real", "bool"):
            self._error(
                node.index.start, f"the number of an element is a whole one; write `int({self._snippet(node.index)})`"
            )
        elif isinstance(index, int) and index < 0:
            self._error(node.index.start, f"elements are counted from 0; the last one is `{text}[size({text}) - 1]`")
        elif isinstance(index, int) and isinstance(whole, Many) and whole.length is not None and index >= whole.length:
            self._error(node.index.start, f"`{text}` has {whole.length} elements, the last one is {whole.length - 1}")
        return element(whole)

    def _unary(self, node: tree.Unary) -> Static:
        operand = self.operand(node.of)
        if node.mark == "!":
            self._told(node.start, operands.boolean("!", operand))
            return BOOL
        self._told(node.start, operands.arithmetic("-", operand, operand))
        return Value(operand.static.kind, "") if isinstance(operand.static, Value) else None

    def _chain(self, node: tree.Chain) -> Static:
        marks = [mark for mark, _ in node.rest]
        operands_of = (node.first, *(part for _, part in node.rest))
        for part, beside in zip(operands_of, pairwise(("", *marks, "")), strict=True):
            if "%" in beside:
                self._shares.add(id(part))
        whole = len(marks) if id(node) in self._shares else _last(marks, "%")
        left = self.operand(node.first)
        for i, (mark, part) in enumerate(node.rest):
            right = self.operand(part)
            self._told(node.start, operands.arithmetic(mark, left, right))
            if mark == "/":
                self._divided(left, right, told=i >= whole)
            left = Operand(node, self._text[node.start : part.end], result_of(mark, left.static, right.static))
        for at, doubt in times.mixed(node, self._text):
            self._warn(at, doubt)
        return left.static

    def _divided(self, left: Operand, right: Operand, *, told: bool) -> None:
        """Warn of a division that fails, and, where that is to be told, of one of whole numbers."""
        if kind(left.static) != "whole" or kind(right.static) != "whole":
            return
        if isinstance(right.node, tree.Literal) and right.node.value == 0:
            self._warn(right.node.start, "a division by zero fails at every message")
            return
        if not told:
            return
        literal = isinstance(right.node, tree.Literal)
        exact = f"{left.text} / {right.text}.0" if literal else f"double({left.text}) / {right.text}"
        what = f"`{left.text} / {right.text}` divides whole numbers, and gives a whole one, as 7 / 2 is 3"
        self._warn(left.node.start, f"{what}; write `{exact}` for the exact one")

    def _compare(self, node: tree.Compare) -> Static:
        left, right = self.operand(node.left), self.operand(node.right)
        if node.mark == "in":
            self._inside(node, left, right)
        else:
            wrong = operands.compared(node.mark, left, right)
            self._told(node.start, wrong)
            for doubt in operands.by_letters(node.mark, left, right) if wrong is None else ():
                self._warn(node.start, doubt)
            if wrong is None:
                self._settled(node, left, right)
        return BOOL

    def _settled(self, node: tree.Compare, left: Operand, right: Operand) -> None:
        """Warn of a comparison that always comes to the same."""
        found = settled.settled(node.mark, left, right, self._number(left.node) or self._number(right.node))
        if found is None and self._is_read(left.node):
            found = settled.itself(node.mark, left, right)
        guards = self._guards.get(id(node), ()) if settled.is_of_a_length(left, right) else ()
        if found is not None and self._ends.get(id(node)) is not found[0] and found[0] not in guards:
            outcome = "always" if found[0] else "never"
            self._warn(node.start, f"`{self._snippet(node)}` is {outcome} true: {found[1]}")

    def _number(self, node: Node) -> Operand | None:
        """What `string` makes a text, None for any other part."""
        if not isinstance(node, tree.Call) or node.name != "string":
            return None
        (argument,) = node.arguments
        return Operand(argument, self._snippet(argument), self._known[id(argument)])

    def _is_read(self, node: Node) -> bool:
        """Whether a part is one of the message, and not computed."""
        match node:
            case tree.Path():
                return True
            case tree.Field(of=of) | tree.Index(of=of) | tree.Loop(kind="filter", of=of):
                return self._is_read(of)
            case tree.Variable(name=name):
                return next(read for variable, _, read in reversed(self._variables) if variable == name)
            case _:
                return False

    def _inside(self, node: tree.Compare, left: Operand, right: Operand) -> None:
        if isinstance(node.right, tree.ListOf):
            self._one_of(node, left, [self.operand(item) for item in node.right.items])
        elif isinstance(right.static, Many | Elements):
            stand_in = Operand(node.right, f"{right.text}[0]", element(right.static))
            self._told(node.start, operands.equal("in", left, stand_in))
        elif isinstance(right.static, Value):
            self._error(node.start, operands.not_inside(left, right))

    def _one_of(self, node: tree.Compare, left: Operand, items: list[Operand]) -> None:
        """Refuse a list that can't have the value; of one that can, warn of the items that never match."""
        wrong = operands.never_matching(left, items)
        if items and len(wrong) == len(items):
            self._told(node.start, operands.outside(left, items[0]))
            return
        for item, message in wrong:
            self._warn(item.node.start, message)
        told = {id(item) for item, _ in wrong}
        number = self._number(left.node)
        never = [(item, settled.settled("==", left, item, number)) for item in items if id(item) not in told]
        whys = [(item, found[1]) for item, found in never if found is not None]
        if whys and len(whys) == len(items):
            self._warn(node.start, f"`{self._snippet(node)}` is never true: {whys[0][1]}")
            return
        for item, why in whys:
            self._warn(item.node.start, f"the item `{item.text}` of the list never matches: {why}")

    def _joined(self, node: tree.Joined) -> Static:
        self._ends |= {id(part): node.mark == "&&" for part in settled.ends(node, self._text)}
        self._guards |= {id(part): (node.mark == "&&",) for part in node.parts}
        told = len(self.problems)
        for part in node.parts:
            self._told(part.start, operands.boolean(node.mark, self.operand(part)))
        if len(self.problems) == told and (doubt := self._joint.told(node, self._snippet)) is not None:
            self._warn(node.start, doubt)
        return BOOL

    def _choice(self, node: tree.Choice) -> Static:
        found, told = [], len(self.problems)
        self._guards |= {id(test): (True, False) for test, _ in node.cases}
        for test, value in node.cases:
            self._told(test.start, operands.boolean("?", self.operand(test)))
            found.append(self.of(value))
        for test, doubt in self._joint.unreached(node, self._snippet) if len(self.problems) == told else ():
            self._warn(test.start, doubt)
        last = self.of(node.otherwise)
        for each in found:
            last = common(last, each)
        return last

    def _call(self, node: tree.Call) -> Static:
        arguments = [self.operand(argument) for argument in node.arguments]
        static, told = called(node, arguments)
        for severity, message in told:
            self.problems.append(Problem(message, place(self._text, node.start), severity))
        if node.name in ("contains", "endsWith", "startsWith"):
            why = settled.never_text(*arguments)
            if why is not None:
                self._warn(node.start, f"`{self._snippet(node)}` is never true: {why}")
        return static

    def _has(self, node: tree.Has) -> Static:
        self.of(node.of)
        return BOOL

    def _loop(self, node: tree.Loop) -> Static:
        whole = self.operand(node.of)
        if isinstance(whole.static, Value):
            more = not_single(whole.static, whole.text)
            self._error(node.start, f"{whole}, and `{node.kind}` takes a list{more}")
        each = TEXT if isinstance(whole.static, Record) else element(whole.static)
        self._variables.append((node.variable, each, self._is_read(node.of)))
        if node.when is not None:
            self._told(node.when.start, operands.boolean(node.kind, self.operand(node.when)))
        body = self.operand(node.body)
        if node.kind != "map":
            self._told(node.body.start, operands.boolean(node.kind, body))
        self._variables.pop()
        if (doubt := settled.unread(node, body.text)) is not None:
            self._warn(node.body.start, doubt)
        if node.kind == "map":
            return Elements(body.static)
        return Elements(each) if node.kind == "filter" else BOOL

    def _list(self, node: tree.ListOf) -> Static:
        found = [self.of(item) for item in node.items]
        alike = found and all(static == found[0] for static in found)
        return Elements(found[0] if alike else None)

    def _map(self, node: tree.MapOf) -> Static:
        for value in node.values:
            self.of(value)
        return None

    def operand(self, node: Node) -> Operand:
        """A part with what is known of its value."""
        return Operand(node, self._snippet(node), self.of(node), self._spans.of(node))

    def _snippet(self, node: Node) -> str:
        return " ".join(self._text[node.start : node.end].split())

    def _told(self, at: int, message: str | None) -> None:
        if message is not None:
            self._error(at, message)

    def _error(self, at: int, message: str) -> None:
        self.problems.append(Problem(message, place(self._text, at)))

    def _warn(self, at: int, message: str) -> None:
        self.problems.append(Problem(message, place(self._text, at), "warning"))


def _last(marks: Sequence[str], wanted: str) -> int:
    """Where a mark stands last, 0 where it does not."""
    return max((i for i, mark in enumerate(marks) if mark == wanted), default=0)
