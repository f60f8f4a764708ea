"""Which names Python's statements bind, hand on and change, and which names may change something when they are used."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

MUTATORS = frozenset({
    "add", "append", "appendleft", "clear", "difference_update", "discard", "extend", "extendleft", "insert",
    "intersection_update", "move_to_end", "pop", "popitem", "popleft", "remove", "reverse", "rotate", "setdefault",
    "sort", "symmetric_difference_update", "update",
})  # fmt: skip
"""Methods that change what they belong to."""
LOGS = frozenset({"print", "logging", "logger", "log", "rospy", "sys", "warnings"})
"""What tells people something, and changes nothing that is judged."""
_ANYTHING = frozenset({"__dict__", "__import__", "delattr", "eval", "exec", "globals", "locals", "modules", "setattr"})
"""Words by which a name may be bound that is not in the text; `modules` is that of `sys`."""
_READ = frozenset({"copy", "count", "get", "index", "items", "keys", "values"})
_READERS = frozenset({
    "all", "any", "dict", "enumerate", "frozenset", "isinstance", "len", "list", "max", "min", "range", "reversed",
    "set", "sorted", "str", "sum", "tuple", "zip", "json", "math", "os", "re", *LOGS,
})  # fmt: skip

Definitions = Mapping[str, Sequence[ast.AST]]
"""What may stand behind a name anywhere in a module: functions, classes, and the expressions that it is given."""


@dataclass(frozen=True, slots=True)
class Scope:
    """What is known of a module's names from its text alone: those of `changing` keep something between messages."""

    changing: frozenset[str] = frozenset()
    definitions: Definitions = field(default_factory=dict)


def read_scope(tree: ast.Module) -> Scope:
    """What is known of a module's names."""
    return Scope(frozenset(_changing(tree)) - {"predicates"}, definitions(tree))


def _changing(tree: ast.Module) -> Iterator[str]:
    """The names that functions may change from one message to the next."""
    functions = (n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda))
    for node in (n for function in functions for n in ast.walk(function)):
        match node:
            case ast.Global(names) | ast.Nonlocal(names):
                yield from names
            case ast.Subscript(base, ctx=ast.Store() | ast.Del()) | ast.Attribute(base, ctx=ast.Store() | ast.Del()):
                yield root(base)
            case ast.Call(ast.Attribute(base, method)) if method in MUTATORS:
                yield root(base)


def bound(body: Iterable[ast.AST]) -> set[str]:
    """The names that statements bind in their own scope, those that they declare global among them."""
    found: set[str] = set()
    for node in _own(body):
        match node:
            case ast.Name(name, ast.Store() | ast.Del()):
                found.add(name)
            case ast.FunctionDef(name) | ast.AsyncFunctionDef(name) | ast.ClassDef(name):
                found.add(name)
            case ast.Import(names) | ast.ImportFrom(_, names):
                found |= {alias.asname or alias.name.split(".")[0] for alias in names}
            case ast.ExceptHandler(_, str() as name) | ast.MatchAs(_, str() as name) | ast.MatchStar(str() as name):
                found.add(name)
            case ast.MatchMapping(_, _, str() as name):
                found.add(name)
    return found


def declared(body: Iterable[ast.AST]) -> set[str]:
    """The names that a scope's statements declare global, or of a function around."""
    return {name for node in _own(body) if isinstance(node, ast.Global | ast.Nonlocal) for name in node.names}


def _own(body: Iterable[ast.AST]) -> Iterator[ast.AST]:
    """The nodes of a scope, without what functions, classes and comprehensions have for themselves."""
    for node in body:
        yield node
        match node:
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                yield from _own(node.decorator_list)
            case ast.Lambda():
                pass
            case ast.comprehension(_, over, ifs):
                yield from _own([over, *ifs])
            case _:
                yield from _own(ast.iter_child_nodes(node))


def definitions(tree: ast.AST) -> Definitions:
    """What may stand behind each name of a module, wherever it is bound."""
    found: dict[str, list[ast.AST]] = {}
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef(name) | ast.AsyncFunctionDef(name) | ast.ClassDef(name):
                found.setdefault(name, []).append(node)
            case ast.Assign(targets, value):
                _give(found, targets, value)
            case ast.AnnAssign(target, _, ast.expr() as value) | ast.NamedExpr(target, value):
                _give(found, [target], value)
            case ast.For(target, value) | ast.withitem(value, ast.expr() as target):
                _give(found, [target], value)
    return found


def _give(found: dict[str, list[ast.AST]], targets: Iterable[ast.expr], value: ast.expr) -> None:
    for target in targets:
        for node in ast.walk(target):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                found.setdefault(node.id, []).append(value)


def reached(node: ast.AST, known: Definitions) -> list[ast.AST]:
    """A node, what stands behind the names that it mentions, behind those that these mention, and so on."""
    found, names = [node], set[str]()
    for one in found:  # it grows
        for name in mentioned(one) - names:
            names.add(name)
            found += known.get(name, ())
    return found


def mentioned(node: ast.AST) -> set[str]:
    """The names and attributes that are read anywhere in a node."""
    names = {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and not isinstance(n.ctx, ast.Store)}
    return names | {n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute)}


def binds_anything(nodes: Iterable[ast.AST]) -> bool:
    """Whether statements may bind names that are not in their text."""
    return any(
        mentioned(node) & _ANYTHING
        or any(isinstance(n, ast.ImportFrom) and n.names[0].name == "*" and n.module != "math" for n in ast.walk(node))
        for node in nodes
    )


def handed(node: ast.AST, known: Definitions) -> set[str]:
    """The names whose values are given away or changed as they are, and not only looked into."""
    looked: set[int] = set()
    for found in ast.walk(node):
        match found:
            case ast.Subscript(base, ctx=ast.Load()) | ast.For(_, base) | ast.comprehension(_, base):
                looked.add(id(base))
            case ast.Attribute(base, attr) if attr in _READ:
                looked.add(id(base))
            case ast.Compare(_, ops, others):
                looked |= {id(o) for op, o in zip(ops, others, strict=True) if isinstance(op, ast.In | ast.NotIn)}
            case ast.Call(function, arguments) if root(function) in _READERS - known.keys():
                looked |= {id(a) for a in arguments}
    names = (n for n in ast.walk(node) if isinstance(n, ast.Name) and id(n) not in looked)
    augmented = {id(n.target) for n in ast.walk(node) if isinstance(n, ast.AugAssign)}
    return {n.id for n in names if isinstance(n.ctx, ast.Load) or id(n) in augmented}


def root(node: ast.expr) -> str:
    """The name at the beginning of `name.a[0].b()`; empty where there is none."""
    while isinstance(node, ast.Attribute | ast.Call | ast.Subscript):
        node = node.func if isinstance(node, ast.Call) else node.value
    return node.id if isinstance(node, ast.Name) else ""
