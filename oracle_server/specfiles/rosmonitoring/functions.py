"""Functions of a module: what their definitions make of them."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable

from oracle_server.specfiles.rosmonitoring.scope import Scope, bound, declared, mentioned, reached, waits
from oracle_server.specfiles.rosmonitoring.values import (
    Const,
    Function,
    Imported,
    Raises,
    Term,
    UnfollowableError,
    Unread,
    UntranslatableError,
    Value,
    leaves,
)

_CACHES = frozenset({"functools.cache", "functools.lru_cache"})


def defined(
    node: ast.FunctionDef,
    find: Callable[[str], Value | None],
    worth: Callable[[ast.expr], Value],
    scope: Scope,
) -> Function:
    """What a definition makes, where `find` says what names stand for, and `worth` what expressions are worth.

    Raises `UntranslatableError` where it is decorated by anything but a cache, or a cache keeps what may change.
    """
    if not all(_is_cache(decorator, find) for decorator in node.decorator_list):
        raise UntranslatableError
    if node.decorator_list and any("predicates" in mentioned(n) for n in reached(node, scope.definitions)):
        raise UntranslatableError
    return Function(node, _defaults(node.args, worth), cached=bool(node.decorator_list))


def _defaults(arguments: ast.arguments, worth: Callable[[ast.expr], Value]) -> dict[str, Value]:
    """The values of parameters that a call need not give."""
    names = [*arguments.posonlyargs, *arguments.args]
    given = list(zip(names[len(names) - len(arguments.defaults) :], arguments.defaults, strict=True))
    given += [(n, d) for n, d in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True) if d is not None]
    found: dict[str, Value] = {}
    for name, default in given:
        try:
            found[name.arg] = worth(default)
        except UnfollowableError:
            raise
        except UntranslatableError:
            found[name.arg] = Unread(ast.unparse(default))
    return found


def parameters(node: ast.FunctionDef) -> list[str]:
    """The names of a function's parameters, those of `*` and `**` left out."""
    return [a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]


def check(node: ast.FunctionDef) -> None:
    """Look whether a function can be followed.

    Raises `UnfollowableError` where it is a generator, calls something else `predicates`, or sets variables of a
    function around.
    """
    names = {a.arg for a in ast.walk(node.args) if isinstance(a, ast.arg)} | bound(node.body)
    if "predicates" in names or waits(node.body):
        raise UnfollowableError
    if any(isinstance(n, ast.Nonlocal) for n in ast.walk(node)):
        raise UnfollowableError


def set_outside(node: ast.FunctionDef, scope: Scope) -> set[str]:
    """The module's variables that a function may set, or one that it mentions."""
    nodes = (n for one in reached(node, scope.definitions) for n in ast.walk(one) if isinstance(n, ast.Global))
    return {name for n in nodes for name in n.names}


def unbound(node: ast.FunctionDef) -> dict[str, Value]:
    """A function's own variables before anything is assigned to them: they hide the module's, and fail."""
    own = bound(node.body) - declared(node.body)
    return {name: Raises("UnboundLocalError") for name in own}


def _is_cache(decorator: ast.expr, find: Callable[[str], Value | None]) -> bool:
    match decorator.func if isinstance(decorator, ast.Call) else decorator:
        case ast.Name(name):
            found = find(name)
        case ast.Attribute(ast.Name(where), name):
            outer = find(where)
            found = Imported(f"{outer.name}.{name}") if isinstance(outer, Imported) else None
        case _:
            return False
    return isinstance(found, Imported) and found.name in _CACHES


def can_be_keys(arguments: Iterable[Value]) -> bool:
    """Whether all of some values are known to be of those that a cache takes; a message, a list and a dict are none."""
    return all(
        isinstance(leaf, Term) or (isinstance(leaf, Const) and not isinstance(leaf.value, list | dict | set))
        for value in arguments
        for leaf in leaves(value)
    )
