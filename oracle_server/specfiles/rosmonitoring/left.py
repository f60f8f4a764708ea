"""What a statement that can't be read may have done: it leaves names unread, or nothing can be said of the function."""

from __future__ import annotations

import ast
from collections.abc import Iterable

from oracle_server.specfiles.rosmonitoring.given import given
from oracle_server.specfiles.rosmonitoring.scope import Scope, binds_unseen, bound, mentioned, reached
from oracle_server.specfiles.rosmonitoring.state import Module, State, lose
from oracle_server.specfiles.rosmonitoring.values import UnfollowableError, Unread

_ELSEWHERE = (
    ast.Return, ast.Delete, ast.Global, ast.Nonlocal, ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.Await,
    ast.Yield, ast.YieldFrom,
)  # fmt: skip


def leave(statement: ast.stmt, state: State, machine: Module) -> None:
    """Mark what a statement that can't be read assigns or gives away. Raises `UnfollowableError` where more may be."""
    elsewhere = any(isinstance(node, _ELSEWHERE) for node in ast.walk(statement))
    scope = machine.scope
    unseen = elsewhere or binds_unseen(statement)
    if unseen or _fails([statement], scope) or mentioned(statement) & scope.changers:
        raise UnfollowableError
    python = ast.unparse(statement)
    for node in ast.walk(statement):
        match node:
            case ast.Subscript(ast.Name("predicates"), ast.Constant(str() as key), ast.Store()):
                state.predicates[key] = Unread(python)
            case ast.Subscript(ctx=ast.Store()) | ast.Attribute(ctx=ast.Store()):
                raise UnfollowableError
    lost, shares = given(statement, state, machine)
    lose(lost, state, machine)
    for own in bound([statement]):
        machine.assign(ast.Name(own), Unread(python, shares[own]), state)


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
