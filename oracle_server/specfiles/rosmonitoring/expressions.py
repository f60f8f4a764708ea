"""Reads Python's expressions over a message of one stream; nothing of them is run but what is made of constants."""

from __future__ import annotations

import ast
import math
from dataclasses import dataclass

from oracle_server.specfiles.rosmonitoring import calls, operators
from oracle_server.specfiles.rosmonitoring.cel import collapsed, inner, number, truth
from oracle_server.specfiles.rosmonitoring.fields import member, there
from oracle_server.specfiles.rosmonitoring.state import Module, State, is_lost
from oracle_server.specfiles.rosmonitoring.values import (
    Const,
    Field,
    Function,
    Imported,
    Items,
    Kept,
    Leaf,
    Message,
    Name,
    Predicates,
    Raises,
    Table,
    Term,
    Unread,
    UntranslatableError,
    Value,
    checked,
    choice,
    each,
    leaves,
)


def evaluate(node: ast.expr, state: State, machine: Module) -> Value:
    """What an expression is worth. Raises `UntranslatableError`."""
    return checked(collapsed(_Reader(state, machine).value(node)))


@dataclass(slots=True)
class _Reader:
    state: State
    machine: Module

    def value(self, node: ast.expr) -> Value:  # noqa: C901, PLR0911, PLR0912 -- a case a kind of expression
        match node:
            case ast.Constant(None | bool() | int() | float() | str() as value):
                return Const(value)
            case ast.Name(name):
                return self._name(name)
            case ast.JoinedStr(parts):
                return self._joined(parts)
            case ast.Subscript(base, index):
                return operators.pairs(self.value(base), self._index(index), self._item)
            case ast.Attribute(ast.Name(where), name) if self._is_math(where) and isinstance(
                getattr(math, name, None), float
            ):
                return Const(getattr(math, name))
            case ast.BoolOp(op, [first, *rest]):
                return collapsed(self._short(op, first, rest))
            case ast.UnaryOp(ast.Not(), operand):
                return operators.opposite(each(self.value(operand), truth))
            case ast.UnaryOp(ast.USub(), operand):
                return each(self.value(operand), _minus)
            case ast.UnaryOp(ast.UAdd(), operand):
                return operators.arithmetic(Const(0), ast.Add(), self.value(operand))
            case ast.BinOp(left, op, right):
                return operators.arithmetic(self.value(left), op, self.value(right))
            case ast.Compare(left, [op, *ops], [right, *rights]):
                return self._compare(self.value(left), op, right, ops, rights)
            case ast.IfExp(test, body, orelse):
                return self._either(each(self.value(test), truth), body, orelse)
            case ast.List(items) | ast.Tuple(items) | ast.Set(items):
                return _items([self.value(item) for item in items], type(node).__name__.lower())
            case ast.Dict(keys, values):
                return self._table(keys, values)
            case ast.Call():
                return self._call(node)
            case ast.GeneratorExp(body, [loop]) | ast.ListComp(body, [loop]) if not loop.ifs and not loop.is_async:
                return self._comprehension(body, loop)
        raise UntranslatableError

    def _name(self, name: str) -> Value:
        found = self.machine.find(name, self.state)
        if found is None and name == "predicates":
            return Predicates()
        if found is None or any(isinstance(leaf, Unread | Function | Imported) for leaf in leaves(found)):
            raise UntranslatableError
        if is_lost(found, self.state, self.machine):
            raise UntranslatableError
        return found

    def _is_math(self, name: str) -> bool:
        return self.machine.find(name, self.state) == Imported("math")

    def _is_builtin(self, *names: str) -> bool:
        return all(self.machine.find(name, self.state) is None for name in names)

    def _joined(self, parts: list[ast.expr]) -> Value:
        text = ""
        for part in parts:
            found = self.value(part.value) if isinstance(part, ast.FormattedValue) else self.value(part)
            if not isinstance(found, Const):
                raise UntranslatableError
            if isinstance(part, ast.FormattedValue) and (part.format_spec is not None or part.conversion != -1):
                raise UntranslatableError
            text += str(found.value)
        return Const(text)

    def _index(self, index: ast.expr) -> Value:
        if isinstance(index, ast.Slice):
            ends = [None if e is None else self.value(e) for e in (index.lower, index.upper, index.step)]
            if not all(e is None or isinstance(e, Const) for e in ends):
                raise UntranslatableError
            return Const(slice(*(e.value if isinstance(e, Const) else None for e in ends)))
        return self.value(index)

    def _item(self, base: Leaf, index: Leaf) -> Value:  # noqa: PLR0911 -- a case a kind of value
        match base, index:
            case Message(), Const(str() as key):
                return self._of_message(key)
            case Predicates(), Const(str() as key):
                return self.predicate(key)
            case Field(), Const(str() as key):
                return member(base, str(key))
            case Field(), Const(int() as place) if not isinstance(place, bool):
                return member(base, place)
            case ((Const(None | bool() | int() | float()) | Term(kind="bool" | "number")), _):
                return Raises("TypeError")
            case Const(str() | list() | tuple() | dict() as value), Const(key):
                return calls.known(value.__getitem__, [key])
            case Items(values), Const(int() as place):
                return values[place] if -len(values) <= place < len(values) else Raises("IndexError")
            case Table(values), Const(key):
                return dict(values).get(str(key), Raises("KeyError"))
        raise UntranslatableError

    def predicate(self, name: str) -> Value:
        """What a predicate is worth now. Raises `UntranslatableError`."""
        found = self.state.predicates.get(name)
        if found is None:
            return Kept(str(name)) if name in self.machine.initial else Raises("KeyError")
        if any(isinstance(leaf, Unread) for leaf in leaves(found)) or is_lost(found, self.state, self.machine):
            raise UntranslatableError
        return found

    def _of_message(self, key: str) -> Value:
        stream = self.machine.stream
        if stream is None or key == "time" or stream.hides(key) or Field((key,)) in self.state.lost:
            raise UntranslatableError
        if key == stream.key:
            return Const(Name(stream.name))
        if stream.kind != "topic":
            if key == stream.kind:
                return stream.whole
            return Raises(f"KeyError: '{key}'")
        if key == "service":
            return Raises("KeyError: 'service'")
        return member(stream.whole, key)

    def _short(self, op: ast.boolop, first: ast.expr, rest: list[ast.expr]) -> Value:
        """`and` and `or`, which are worth one of their operands; the later ones may fail where the first decides."""
        value = self.value(first)
        if not rest:
            return value

        def after(leaf: Leaf) -> Value:
            test: Value = Term("", "bool") if isinstance(leaf, Kept) else truth(leaf)
            if isinstance(test, Const):
                decided = bool(test.value) is isinstance(op, ast.Or)
                return leaf if decided else self._short(op, rest[0], rest[1:])
            more = self._short(op, rest[0], rest[1:])
            if isinstance(leaf, Kept):
                return self._with_kept(leaf, op, more)
            decided_value: Value = (
                Const(isinstance(op, ast.Or)) if isinstance(leaf, Term) and leaf.kind == "bool" else leaf
            )
            return choice(test, decided_value, more) if isinstance(op, ast.Or) else choice(test, more, decided_value)

        return each(value, after)

    def _with_kept(self, kept: Kept, op: ast.boolop, more: Value) -> Value:
        """`kept or more`, where both are Boolean: then it is true where `more` is, and kept elsewhere."""
        if not all((isinstance(v, Const) and isinstance(v.value, bool)) or (isinstance(v, Term) and v.kind == "bool")
                   for v in leaves(more)) or kept.name not in self.machine.flags:  # fmt: skip
            raise UntranslatableError
        return choice(more, Const(True), kept) if isinstance(op, ast.Or) else choice(more, kept, Const(False))

    def _compare(
        self, left: Value, op: ast.cmpop, right: ast.expr, ops: list[ast.cmpop], rights: list[ast.expr]
    ) -> Value:
        if isinstance(op, ast.In | ast.NotIn) and isinstance(right, ast.Name | ast.Call):
            found = self._in_known(left, op, right)
        else:
            found = None
        other = self.value(right) if found is None or ops else Const(None)
        found = operators.compare(left, op, other) if found is None else found
        if not ops:
            return found
        return choice(found, self._compare(other, ops[0], rights[0], ops[1:], rights[1:]), Const(False))

    def _in_known(self, left: Value, op: ast.cmpop, right: ast.expr) -> Value | None:
        """`key in message` and `key in predicates`, which the stream or the module decides."""
        where = self.value(right)
        stream = self.machine.stream
        if not isinstance(left, Const) or not isinstance(left.value, str):
            return None
        key, known = left.value, None
        if isinstance(where, Predicates) and isinstance(self.machine.initial.get(key), Unread):
            raise UntranslatableError
        if isinstance(where, Message) and stream is not None:
            if stream.hides(key):
                raise UntranslatableError
            if key in ("topic", "service", "time") or stream.kind != "topic":
                known = key in (stream.key, "time", stream.kind)
            else:
                test = there(stream.whole, key)
                return test if isinstance(op, ast.In) else operators.opposite(test)
        elif isinstance(where, Predicates):
            known = key in self.machine.initial or key in self.state.predicates
            if not known and key.strip("/") in self.machine.initial:
                raise UntranslatableError
        return None if known is None else Const(known is isinstance(op, ast.In))

    def _either(self, test: Value, body: ast.expr, orelse: ast.expr) -> Value:
        if isinstance(test, Const):
            return self.value(body if test.value else orelse)
        return choice(test, self.value(body), self.value(orelse))

    def _table(self, keys: list[ast.expr | None], values: list[ast.expr]) -> Value:
        found: dict[str, Value] = {}
        for key, value in zip(keys, values, strict=True):
            name = None if key is None else self.value(key)
            if not isinstance(name, Const) or not isinstance(name.value, str):
                raise UntranslatableError
            found[str(name.value)] = self.value(value)
        if all(isinstance(v, Const) for v in found.values()):
            return Const({k: v.value for k, v in found.items() if isinstance(v, Const)})
        return Table(tuple(found.items()))

    def _call(self, node: ast.Call) -> Value:  # noqa: PLR0911 -- a case a kind of call
        match node:
            case ast.Call(ast.Name(name)) if isinstance(self.machine.find(name, self.state), Function):
                return self.machine.call(name, node, self.state)
            case ast.Call(ast.Name(name)) if not self._is_builtin(name):
                raise UntranslatableError
            case ast.Call(ast.Name("dict"), [], keywords) if keywords and all(k.arg for k in keywords):
                return self._table([ast.Constant(k.arg) for k in keywords], [k.value for k in keywords])
            case ast.Call(ast.Name("isinstance"), [value, ast.Name(wanted)], []) if self._is_builtin(wanted):
                return each(self.value(value), lambda leaf: calls.kind_of(leaf, wanted))
            case ast.Call(ast.Name("isinstance") as asked, [value, ast.Tuple([_, *_] as several)], []):
                tests: list[ast.expr] = [ast.Call(asked, [value, one], []) for one in several]
                return self._short(ast.Or(), tests[0], tests[1:])
            case ast.Call(ast.Name(name), arguments, []):
                return calls.function(name, [self.value(a) for a in arguments])
            case ast.Call(ast.Attribute(ast.Name(where), name), arguments, []) if self._is_math(where):
                return calls.mathematics(name, [self.value(a) for a in arguments])
            case ast.Call(ast.Attribute(base, name), arguments, keywords):
                found, given = self.value(base), [self.value(a) for a in arguments]
                if keywords:
                    return self._formatted(found, name, given, keywords)
                return each(found, lambda leaf: self._method(leaf, name, given))
        raise UntranslatableError

    def _formatted(self, base: Value, name: str, given: list[Value], keywords: list[ast.keyword]) -> Value:
        named = {k.arg: self.value(k.value) for k in keywords if k.arg}
        if (
            name != "format"
            or not isinstance(base, Const)
            or not isinstance(base.value, str)
            or len(named) < len(keywords)
        ):
            raise UntranslatableError
        if not all(isinstance(v, Const) for v in (*given, *named.values())):
            raise UntranslatableError
        values = {str(k): v.value for k, v in named.items() if isinstance(v, Const)}
        plain = [v.value for v in given if isinstance(v, Const)]

        def format(*arguments: object) -> str:  # noqa: A001 -- the name is what limits go by
            return str(base.value).format(*arguments, **values)

        return calls.known(format, plain)

    def _method(self, leaf: Leaf, name: str, given: list[Value]) -> Value:
        if name == "get" and given and isinstance(given[0], Const) and isinstance(given[0].value, str):
            key, default = given[0].value, given[1] if len(given) > 1 else Const(None)
            if isinstance(leaf, Message):
                found, stream = self._of_message(key), self.machine.stream
                if isinstance(found, Raises):
                    return default
                if stream is None or key == stream.key or stream.kind != "topic":
                    return found
                return choice(there(stream.whole, key), found, default)
            if isinstance(leaf, Predicates):
                if key not in self.machine.initial and key not in self.state.predicates:
                    raise UntranslatableError
                return self.predicate(key)
        return calls.method(leaf, name, given)

    def _comprehension(self, body: ast.expr, loop: ast.comprehension) -> Value:
        over = self.value(loop.iter)
        if not isinstance(over, Const | Items):
            raise UntranslatableError
        values = list(over.values) if isinstance(over, Items) else [Const(v) for v in _listed(over.value)]
        if len(values) > 64:
            raise UntranslatableError
        found = []
        for value in values:
            inner = self.state.copy()
            self.machine.assign(loop.target, value, inner)
            found.append(evaluate(body, inner, self.machine))
            self.state.lost |= inner.lost
        if is_lost(over, self.state, self.machine):
            raise UntranslatableError
        return _items(found, "list")


def _listed(value: object) -> list[object]:
    if isinstance(value, str | list | tuple | set | frozenset | dict):
        return list(value)
    raise UntranslatableError


def _minus(leaf: Leaf) -> Value:
    if isinstance(leaf, Const):
        return calls.known(lambda v: -v, [leaf.value])
    if isinstance(leaf, Term) and leaf.kind == "number" and leaf.whole:
        return Term(f"(-{inner(leaf)})", "number", tight=True, whole=True)
    return Term(f"(-{number(leaf)})", "number", tight=True)


def _items(values: list[Value], kind: str) -> Value:
    if not all(isinstance(v, Const) for v in values):
        return Items(tuple(values))
    plain = [v.value for v in values if isinstance(v, Const)]
    try:
        return Const({"tuple": tuple, "set": set}.get(kind, list)(plain))
    except TypeError:
        raise UntranslatableError from None
