"""What a statement that can't be read may have done: it leaves names unread, or nothing can be said of the function."""

from __future__ import annotations

import ast

from oracle_server.specfiles.rosmonitoring.expressions import Module, State
from oracle_server.specfiles.rosmonitoring.scope import ANYTHING, MUTATORS, bound, handed, mentioned, raises, root
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
    if elsewhere or raises(statement) or mentioned(statement) & (scope.changers | scope.failing | ANYTHING):
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
