"""Reads a property module of ROSMonitoring's oracle from its syntax tree; it is never imported."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from oracle_server.specfiles.rosmonitoring.config import ConfigError
from oracle_server.specfiles.rosmonitoring.expressions import State, Stream, evaluate
from oracle_server.specfiles.rosmonitoring.statements import Machine, UnfollowableError
from oracle_server.specfiles.rosmonitoring.values import Const, Message, Table, Unread, UntranslatableError, Value

_MUTATORS = frozenset({
    "add", "append", "appendleft", "clear", "extend", "insert", "pop", "popleft", "remove", "setdefault", "sort",
    "update",
})  # fmt: skip
_ELSEWHERE = {
    ".rml": "an RML specification", ".pl": "a Prolog specification", ".hoa": "an automaton", ".txt": "a text",
    ".jar": "an archive", ".csp": "a CSP specification", ".json": "JSON", ".yaml": "YAML", ".yml": "YAML",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class PropertyModule:
    """A module's formula, its predicates' initial values, and its function `abstract_message`."""

    name: str
    formula: str
    initial: dict[str, Value]
    function: ast.FunctionDef
    constants: dict[str, Value] = field(default_factory=dict)
    functions: dict[str, ast.FunctionDef] = field(default_factory=dict)
    changing: frozenset[str] = frozenset()

    @property
    def argument(self) -> str:
        """What the function calls the message."""
        return self.function.args.args[0].arg

    @property
    def python(self) -> str:
        """The function, as Python."""
        return ast.unparse(self.function)

    def machine(self, stream: Stream, flags: frozenset[str]) -> Machine:
        """What follows the function at a message of a stream."""
        return Machine(self.constants, self.functions, self.initial, flags, self.changing, stream)

    def start(self) -> State:
        """The state in which the function begins."""
        return State({self.argument: Message()})


def read_module(path: Path) -> PropertyModule:
    """Read a property module. Raises `ConfigError` with file and line."""
    if path.suffix in _ELSEWHERE:
        raise ConfigError(
            f"{path}: {_ELSEWHERE[path.suffix]}, and no property module (.py): its own oracle judges it; without "
            "--properties the spec asks that oracle, by `engine: external`"
        )
    try:
        tree = ast.parse(path.read_bytes(), str(path))
    except OSError as error:
        raise ConfigError(f"{path}: can't be read: {error.strerror}") from None
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise ConfigError(f"{path}:{getattr(error, 'lineno', 1)}: not Python: {getattr(error, 'msg', error)}") from None
    try:
        return _module(path, tree)
    except RecursionError:
        raise ConfigError(f"{path}: is nested too deep to be read") from None


def _module(path: Path, tree: ast.Module) -> PropertyModule:
    functions = {s.name: s for s in tree.body if isinstance(s, ast.FunctionDef)}
    state, initial = State(), dict[str, Value]()
    machine = Machine(state.variables, functions)
    for statement in tree.body:
        _run(statement, state, machine, initial)
    formula, function = state.variables.get("PROPERTY"), functions.get("abstract_message")
    if formula is None:
        raise ConfigError(f"{path}: not a property module: it has no `PROPERTY = '…'`")
    if not isinstance(formula, Const) or not isinstance(formula.value, str):
        raise ConfigError(f"{path}: `PROPERTY` is not made of constants; write its text as `PROPERTY = '…'`")
    if function is None or not function.args.args:
        raise ConfigError(f"{path}: not a property module: it has no function `abstract_message(message)`")
    name = re.sub(r"[^A-Za-z0-9_.-]", "_", path.stem)[:64]
    changing = frozenset(_changing(functions.values()))
    initial |= state.predicates
    return PropertyModule(
        name, " ".join(formula.value.split()), initial, function, state.variables, functions, changing
    )


def _run(statement: ast.stmt, state: State, machine: Machine, initial: dict[str, Value]) -> None:
    match statement:
        case ast.Assign([ast.Name("predicates")], value) | ast.AnnAssign(
            ast.Name("predicates"), _, ast.expr() as value
        ):
            initial.clear()
            initial.update(_initial(value, state, machine))
        case ast.FunctionDef() | ast.ClassDef() | ast.AsyncFunctionDef():
            pass
        case _:
            try:
                machine.follow([statement], state)
            except UntranslatableError:
                stores = (n for n in ast.walk(statement) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store))
                state.variables.update({n.id: Unread(ast.unparse(statement)) for n in stores})


def _initial(value: ast.expr, state: State, machine: Machine) -> dict[str, Value]:
    if isinstance(value, ast.Call) and not value.args and not value.keywords:
        return {}
    try:
        found = evaluate(value, state, machine)
    except (UntranslatableError, UnfollowableError):
        keys = [k.arg for k in value.keywords] if isinstance(value, ast.Call) else []
        if isinstance(value, ast.Dict):
            keys = [str(k.value) if isinstance(k, ast.Constant) else None for k in value.keys]
        return {str(k): Unread(ast.unparse(value)) for k in keys if k is not None}
    if isinstance(found, Const) and isinstance(found.value, dict):
        return {str(k): Const(v) for k, v in found.value.items()}
    return dict(found.values) if isinstance(found, Table) else {}


def _changing(functions: Iterable[ast.FunctionDef]) -> Iterator[str]:
    """The names that functions may change from one message to the next, `predicates` left out."""
    for function in functions:
        for node in ast.walk(function):
            match node:
                case ast.Global(names) | ast.Nonlocal(names):
                    yield from names
                case ast.Subscript(ast.Name(name), ctx=ast.Store() | ast.Del()) if name != "predicates":
                    yield name
                case ast.Call(ast.Attribute(ast.Name(name), method)) if method in _MUTATORS and name != "predicates":
                    yield name
