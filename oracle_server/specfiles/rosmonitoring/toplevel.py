"""Follows the statements of a property module itself, each of which counts for all that comes after it.

What can't be followed makes all that it binds, changes or hands on unread.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping

from oracle_server.specfiles.rosmonitoring.expressions import evaluate
from oracle_server.specfiles.rosmonitoring.scope import acts, binds_anything, bound, handed, mentioned, reached
from oracle_server.specfiles.rosmonitoring.state import State
from oracle_server.specfiles.rosmonitoring.statements import Machine
from oracle_server.specfiles.rosmonitoring.values import (
    Const,
    Imported,
    Table,
    Unread,
    UntranslatableError,
    Value,
    shared,
)


class Unknown(dict[str, Value]):
    """Predicates of which not even the names are known: each that is asked for is there, and unread."""

    def __init__(self, python: str) -> None:
        super().__init__()
        self._unread = Unread(python)

    def __contains__(self, key: object) -> bool:
        return True

    def __missing__(self, key: str) -> Value:
        return self._unread

    def get(self, key: str, default: object = None) -> Value:  # noqa: ARG002 -- as a dict has it
        """The value, unread where it is not known."""
        return self[key]


def follow_top(statement: ast.stmt, state: State, machine: Machine) -> None:
    """Follow one statement of a module; `state` is what its names and predicates are until then."""
    try:
        match statement:
            case ast.Assign([ast.Name("predicates")], value) | ast.AnnAssign(
                ast.Name("predicates"), _, ast.expr() as value
            ):
                state.predicates = _initial(value, state, machine)
            case _:
                machine.follow([statement], state)
    except UntranslatableError:
        _spoil(statement, state, machine)


def sharing(variables: Mapping[str, Value], names: Iterable[str]) -> frozenset[str]:
    """The names of what may be changed by way of some names, too."""
    own = {i for name in names if name in variables for i in shared(variables[name])}
    return frozenset(name for name, value in variables.items() if own & set(shared(value)))


def _spoil(statement: ast.stmt, state: State, machine: Machine) -> None:
    python, known = ast.unparse(statement), machine.scope.definitions
    nodes = reached(_without_methods(statement), known)
    names = bound([statement]) | {
        n for one in nodes for g in ast.walk(one) if isinstance(g, ast.Global) for n in g.names
    }
    touched = {name.id for one in nodes for name in handed(one, known)}
    looked_into = {name for one in nodes for name in mentioned(one) if _is_deep(state.variables.get(name))}
    if binds_anything(nodes):
        machine.opaque, names = True, names | state.variables.keys() | {"predicates"}
    names |= sharing(state.variables, touched | (looked_into if any(acts(one, known) for one in nodes) else set()))
    if "predicates" in names | touched:
        state.predicates = _named(statement, python)
    shares = frozenset(i for name in looked_into for i in shared(state.variables[name]))
    state.variables |= {name: Unread(python, shares) for name in names - {"predicates"}}


def _without_methods(statement: ast.stmt) -> ast.stmt:
    """A class without what runs only when somebody uses it."""
    if not isinstance(statement, ast.ClassDef):
        return statement
    body = [s for s in statement.body if not isinstance(s, ast.FunctionDef | ast.AsyncFunctionDef)]
    return ast.ClassDef(statement.name, statement.bases, statement.keywords, body, statement.decorator_list)


def _is_deep(value: Value | None) -> bool:
    """Whether a value has lists or dicts inside of others, which may be changed by whoever looks into it."""
    return len(set(shared(value))) > 1


def _initial(value: ast.expr, state: State, machine: Machine) -> dict[str, Value]:
    """Predicates as a module gives them. Raises `UntranslatableError`."""
    if isinstance(value, ast.Call) and _makes_empty(value, state, machine):
        return {}
    match evaluate(value, state, machine):
        case Const(dict() as found):
            return {str(k): Const(v) for k, v in found.items()}
        case Table(values):
            return dict(values)
    raise UntranslatableError


def _makes_empty(call: ast.Call, state: State, machine: Machine) -> bool:
    match call:
        case ast.Call(ast.Name(name)):
            made = machine.find(name, state)
            plain = name == "dict" and made is None
        case ast.Call(ast.Attribute(ast.Name(where), name)):
            outer = machine.find(where, state)
            made, plain = Imported(f"{outer.name}.{name}") if isinstance(outer, Imported) else None, False
        case _:
            return False
    nothing = not call.args and not call.keywords
    return (
        (plain and nothing)
        or made == Imported("collections.defaultdict")
        or (made == Imported("collections.OrderedDict") and nothing)
    )


def _named(statement: ast.stmt, python: str) -> dict[str, Value]:
    """Predicates whose values can't be read, by those of their names that can."""
    names: list[str | None] = [None]
    match statement:
        case ast.Assign([ast.Name("predicates")], value) | ast.AnnAssign(ast.Name("predicates"), _, value):
            match value:
                case ast.Call(ast.Name("dict"), [], keywords):
                    names = [k.arg for k in keywords]
                case ast.Dict(keys):
                    names = [
                        k.value if isinstance(k, ast.Constant) and isinstance(k.value, str) else None for k in keys
                    ]
    if None in names:
        return Unknown(python)
    return {str(name): Unread(python) for name in names}
