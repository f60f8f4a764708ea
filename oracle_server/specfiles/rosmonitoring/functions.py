"""Functions of a module: what their definitions make of them."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable

from oracle_server.specfiles.rosmonitoring.scope import Scope, mentioned, reached
from oracle_server.specfiles.rosmonitoring.values import (
    Const,
    Function,
    Imported,
    Term,
    UntranslatableError,
    Value,
    leaves,
)

_CACHES = frozenset({"functools.cache", "functools.lru_cache"})


def defined(node: ast.FunctionDef, find: Callable[[str], Value | None], scope: Scope) -> Function:
    """What a definition makes, where `find` says what names stand for.

    Raises `UntranslatableError` where it is decorated by anything but a cache, or a cache keeps what may change.
    """
    if not all(_is_cache(decorator, find) for decorator in node.decorator_list):
        raise UntranslatableError
    if node.decorator_list and any("predicates" in mentioned(n) for n in reached(node, scope.definitions)):
        raise UntranslatableError
    return Function(node, cached=bool(node.decorator_list))


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
