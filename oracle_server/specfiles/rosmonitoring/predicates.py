"""Translates the predicates of a property module's function from Python to CEL, for the messages of one stream."""

from __future__ import annotations

import ast
from dataclasses import dataclass, field

from oracle_server.core.errors import OracleError

_COMPARE = {ast.Eq: "==", ast.NotEq: "!=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}
_ARITHMETIC = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*"}


class UntranslatableError(OracleError):
    """Python that has no plain counterpart in CEL."""


@dataclass(slots=True)
class Effect:
    """What a function assigns at a message: CEL by predicate; `unread` is Python that can't be translated, likewise."""

    assigned: dict[str, str] = field(default_factory=dict)
    unread: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Stream:
    """A stream as its messages show it: `key` is `topic` or `service`, under which they have its name."""

    key: str
    name: str
    kind: str

    def has(self, key: str, value: object) -> bool:
        """Whether a message of the stream has this `topic` or `service`, with or without the leading slash."""
        return key == self.key and isinstance(value, str) and value.removeprefix("/") == self.name.removeprefix("/")


def effect(function: ast.FunctionDef, stream: Stream) -> Effect:
    """What a function assigns at a message of a stream."""
    return _run(function.body, _Reader(function.args.args[0].arg if function.args.args else "message", stream))


@dataclass(slots=True)
class _Reader:
    """Reads expressions over the function's argument."""

    argument: str
    stream: Stream

    def cel(self, node: ast.expr) -> str:  # noqa: C901, PLR0911 -- a case a kind of expression
        """An expression in CEL; `true` and `false` where the stream decides it. Raises `UntranslatableError`."""
        match node:
            case ast.Constant(bool() as value):
                return "true" if value else "false"
            case ast.Constant(int() | float() as value):
                return repr(value)
            case ast.Constant(str() as value) if value.isprintable() and "'" not in value and "\\" not in value:
                return f"'{value}'"
            case ast.Subscript() | ast.Call(ast.Attribute(attr="get")):
                return self._field(node)
            case ast.BoolOp(op, values):
                return _joined([self.cel(v) for v in values], "&&" if isinstance(op, ast.And) else "||")
            case ast.UnaryOp(ast.Not(), operand):
                inner = self.cel(operand)
                return {"true": "false", "false": "true"}.get(inner, f"!({inner})")
            case ast.UnaryOp(ast.USub(), operand):
                return f"-{self.cel(operand)}"
            case ast.BinOp(left, op, right) if type(op) in _ARITHMETIC:
                return f"({self.cel(left)} {_ARITHMETIC[type(op)]} {self.cel(right)})"
            case ast.Compare(left, [op], [right]):
                return self._compare(left, op, right)
            case ast.IfExp(test, body, orelse):
                return _chosen(self.cel(test), self.cel(body), self.cel(orelse))
            case ast.Call(ast.Name("str"), [value], []):
                return f"string({self.cel(value)})"
        raise UntranslatableError

    def _compare(self, left: ast.expr, op: ast.cmpop, right: ast.expr) -> str:
        decided = self._decided(left, op, right)
        if decided is not None:
            return "true" if decided else "false"
        if isinstance(op, ast.In | ast.NotIn):
            if isinstance(right, ast.List | ast.Tuple | ast.Set):
                inside = f"{self.cel(left)} in [{', '.join(self.cel(v) for v in right.elts)}]"
            elif isinstance(left, ast.Constant) and isinstance(left.value, str):
                inside = f"{self.cel(right)}.contains({self.cel(left)})"
            else:
                raise UntranslatableError
            return inside if isinstance(op, ast.In) else f"!({inside})"
        if type(op) not in _COMPARE:
            raise UntranslatableError
        return f"{self.cel(left)} {_COMPARE[type(op)]} {self.cel(right)}"

    def _decided(self, left: ast.expr, op: ast.cmpop, right: ast.expr) -> bool | None:
        """The value of a comparison that depends on the stream alone, None for any other one."""
        if isinstance(left, ast.Constant) and self._is_argument(right) and isinstance(op, ast.In | ast.NotIn):
            special = {"topic", "service", "request", "response"}
            if left.value not in special:
                return None
            return (left.value in (self.stream.key, self.stream.kind)) is isinstance(op, ast.In)
        key = self._key(left)
        if key not in ("topic", "service"):
            return None
        values = right.elts if isinstance(right, ast.List | ast.Tuple | ast.Set) else [right]
        if not all(isinstance(v, ast.Constant) for v in values):
            return None
        same = any(self.stream.has(key, v.value) for v in values if isinstance(v, ast.Constant))
        if isinstance(op, ast.Eq | ast.In):
            return same
        return not same if isinstance(op, ast.NotEq | ast.NotIn) else None

    def _is_argument(self, node: ast.expr) -> bool:
        return isinstance(node, ast.Name) and node.id == self.argument

    def _key(self, node: ast.expr) -> str | None:
        """The field that `message['x']` or `message.get('x')` reads."""
        match node:
            case ast.Subscript(value, ast.Constant(str() as key)) if self._is_argument(value):
                return key
            case ast.Call(ast.Attribute(value, "get"), [ast.Constant(str() as key), *_]) if self._is_argument(value):
                return key
        return None

    def _field(self, node: ast.expr) -> str:
        path: list[str] = []
        while not self._is_argument(node):
            match node:
                case ast.Subscript(value, ast.Constant(str() as key)) if key.isidentifier():
                    path.insert(0, f".{key}")
                case ast.Subscript(value, ast.Constant(int() as index)) if index >= 0:
                    path.insert(0, f"[{index}]")
                case ast.Call(ast.Attribute(value, "get"), [ast.Constant(str() as key), *_]) if key.isidentifier():
                    path.insert(0, f".{key}")
                case _:
                    raise UntranslatableError
            node = value
        if self.stream.kind != "topic" and path[:1] == [f".{self.stream.kind}"]:
            path.pop(0)
        elif path[:1] in ([".topic"], [".service"], [".time"], [".request"], [".response"]):
            raise UntranslatableError
        return "msg" + "".join(path)


def _run(body: list[ast.stmt], reader: _Reader) -> Effect:
    found = Effect()
    for statement in body:
        match statement:
            case ast.Assign([ast.Subscript(ast.Name(), ast.Constant(str() as name))], value):
                try:
                    found.assigned[name] = reader.cel(value)
                    found.unread.pop(name, None)
                except UntranslatableError:
                    found.unread[name] = ast.unparse(statement)
            case ast.If():
                _branch(found, statement, reader)
            case ast.Return():
                break
            case _:
                for name in _assigned_in(statement):
                    found.unread[name] = ast.unparse(statement)
    return found


def _branch(found: Effect, statement: ast.If, reader: _Reader) -> None:
    yes, no = _run(statement.body, reader), _run(statement.orelse, reader)
    try:
        test = reader.cel(statement.test)
    except UntranslatableError:
        test = ""
    if test in ("true", "false"):
        taken = yes if test == "true" else no
        found.assigned |= taken.assigned
        found.unread |= taken.unread
        return
    for name in dict.fromkeys((*yes.assigned, *no.assigned, *yes.unread, *no.unread)):
        a = yes.assigned.get(name, found.assigned.get(name))
        b = no.assigned.get(name, found.assigned.get(name))
        if not test or a is None or b is None or name in yes.unread or name in no.unread:
            found.unread[name] = ast.unparse(statement)
        else:
            found.assigned[name] = _chosen(test, a, b)


def _chosen(test: str, yes: str, no: str) -> str:
    if (yes, no) == ("true", "false"):
        return test
    if (yes, no) == ("false", "true"):
        return f"!({test})"
    return yes if yes == no else f"{test} ? {yes} : {no}"


def _joined(values: list[str], op: str) -> str:
    unit, zero = ("true", "false") if op == "&&" else ("false", "true")
    if zero in values:
        return zero
    left = [f"({v})" if "||" in v or "&&" in v or "?" in v else v for v in values if v != unit]
    return f" {op} ".join(left) or unit


def _assigned_in(statement: ast.stmt) -> list[str]:
    return [
        node.slice.value
        for node in ast.walk(statement)
        if isinstance(node, ast.Subscript)
        and isinstance(node.ctx, ast.Store)
        and isinstance(node.slice, ast.Constant)
        and isinstance(node.slice.value, str)
    ]
