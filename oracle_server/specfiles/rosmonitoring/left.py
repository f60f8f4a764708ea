"""What a statement that can't be read may have done: it leaves names unread, or nothing can be said of the function."""

from __future__ import annotations

import ast
from collections.abc import Iterable

from oracle_server.specfiles.rosmonitoring.expressions import Module, State
from oracle_server.specfiles.rosmonitoring.scope import (
    ANYTHING,
    MUTATORS,
    Scope,
    bound,
    handed,
    mentioned,
    reached,
    root,
)
from oracle_server.specfiles.rosmonitoring.values import (
    Field,
    Message,
    Predicates,
    UnfollowableError,
    Unread,
    UntranslatableError,
    Value,
    containers,
    leaves,
)

_ELSEWHERE = (
    ast.Return, ast.Delete, ast.Global, ast.Nonlocal, ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.Await,
    ast.Yield, ast.YieldFrom,
)  # fmt: skip


def leave(statement: ast.stmt, state: State, machine: Module) -> None:
    """Mark what a statement that can't be read assigns or hands on. Raises `UnfollowableError` where more may be."""
    elsewhere = any(isinstance(node, _ELSEWHERE) for node in ast.walk(statement))
    scope = machine.scope
    if elsewhere or _fails([statement], scope) or mentioned(statement) & (scope.changers | ANYTHING):
        raise UnfollowableError
    stored: set[int] = set()
    for node in ast.walk(statement):
        match node:
            case ast.Subscript(ast.Name("predicates") as base, ast.Constant(str() as key), ast.Store()):
                state.predicates[key] = Unread(ast.unparse(statement))
                stored.add(id(base))
            case ast.Subscript(ctx=ast.Store()) | ast.Attribute(ctx=ast.Store()):
                raise UnfollowableError
            case ast.Call(ast.Attribute(base, method)) if method in MUTATORS:
                _check_change(root(base), state, machine)
            case ast.AugAssign(ast.Name(name)):
                _check_shared(name, state, machine)
    for given in handed(statement, scope.definitions):
        if id(given) not in stored:
            _hand(given.id, state, machine, Unread(ast.unparse(statement)))
    for own in bound([statement]):
        machine.assign(ast.Name(own), Unread(ast.unparse(statement)), state)


def _fails(nodes: Iterable[ast.AST], scope: Scope) -> bool:
    """Whether statements, or functions that they mention, raise errors by themselves that are not caught in them."""
    for node in nodes:
        match node:
            case ast.Try(body, handlers, orelse, final):
                tried, rest = _raised(body, scope), [*handlers, *orelse, *final]
                caught = {ast.unparse(kind) for h in handlers for kind in _kinds(h)}
                more = tried & {"SystemExit", "KeyboardInterrupt"} if "Exception" in caught else tried
                if ("BaseException" not in caught and more - caught) or _fails(rest, scope):
                    return True
            case ast.Raise() | ast.Assert():
                return True
            case ast.Name(name) | ast.Attribute(_, name) if name in scope.failing:
                return True
            case _ if _fails(ast.iter_child_nodes(node), scope):
                return True
    return False


def _raised(body: Iterable[ast.AST], scope: Scope) -> set[str]:
    """What statements, and the functions that they mention, raise by themselves; empty texts are not known."""
    nodes = [n for s in body for one in reached(s, scope.definitions) for n in ast.walk(one)]
    raised = (n.exc.func if isinstance(n.exc, ast.Call) else n.exc for n in nodes if isinstance(n, ast.Raise))
    named = {ast.unparse(error) if error else "" for error in raised}
    return named | ({"AssertionError"} if any(isinstance(n, ast.Assert) for n in nodes) else set())


def _kinds(handler: ast.ExceptHandler) -> list[ast.expr]:
    if handler.type is None:
        return [ast.Name("BaseException")]
    return handler.type.elts if isinstance(handler.type, ast.Tuple) else [handler.type]


def _found(name: str, state: State, machine: Module) -> Value | None:
    try:
        found = machine.find(name, state)
    except UntranslatableError:
        return None
    return Predicates() if found is None and name == "predicates" else found


def _check_change(name: str, state: State, machine: Module) -> None:
    """A method changes what begins at a name: a module's own list is one of `changing`, and a local one is marked."""
    found = _found(name, state, machine)
    if found is not None and any(isinstance(leaf, Message | Field | Predicates) for leaf in leaves(found)):
        raise UnfollowableError
    _check_shared(name, state, machine)


def _check_shared(name: str, state: State, machine: Module) -> None:
    """Whether what is changed is of the module, where the next message finds it, but for what is known to change."""
    lasting = {i for value in machine.constants.values() for i in containers(value)}
    if state.owner(name) is not None and lasting & set(containers(_found(name, state, machine))):
        raise UnfollowableError


def _hand(name: str, state: State, machine: Module, unread: Unread) -> None:
    """Whoever is given a list may change it, by each of its names."""
    found = _found(name, state, machine)
    if found is not None and any(isinstance(leaf, Predicates) for leaf in leaves(found)):
        raise UnfollowableError
    own, frame = set(containers(found)), state if state.owner(name) is not None else None
    while frame is not None:
        frame.variables |= {n: unread for n, value in frame.variables.items() if own & set(containers(value))}
        frame = frame.around
