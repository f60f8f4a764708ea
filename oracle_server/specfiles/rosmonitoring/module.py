"""Reads a property module of ROSMonitoring's oracle from its syntax tree; it is never imported."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from oracle_server.specfiles.rosmonitoring.config import ConfigError
from oracle_server.specfiles.rosmonitoring.functions import check, parameters, unbound
from oracle_server.specfiles.rosmonitoring.scope import Scope, read_scope
from oracle_server.specfiles.rosmonitoring.state import State
from oracle_server.specfiles.rosmonitoring.statements import Machine
from oracle_server.specfiles.rosmonitoring.streams import Stream
from oracle_server.specfiles.rosmonitoring.toplevel import follow_top
from oracle_server.specfiles.rosmonitoring.values import (
    Const,
    Function,
    Message,
    Ref,
    UnfollowableError,
    Value,
    shared,
)

_ELSEWHERE = {
    ".rml": "an RML specification", ".pl": "a Prolog specification", ".hoa": "an automaton", ".txt": "a text",
    ".jar": "an archive", ".csp": "a CSP specification", ".json": "JSON", ".yaml": "YAML", ".yml": "YAML",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class PropertyModule:
    """A module's formula, its predicates' initial values, its function `abstract_message`, and what its names are.

    `constants` are what its names stand for once all of it has run, `opaque` whether others may stand for anything.
    """

    name: str
    formula: str
    initial: dict[str, Value]
    function: ast.FunctionDef
    constants: dict[str, Value] = field(default_factory=dict)
    scope: Scope = field(default_factory=Scope)
    opaque: bool = False
    lost: frozenset[Ref] = frozenset()
    """Lists and dicts among the constants that may change from one message to the next."""

    @property
    def argument(self) -> str:
        """What the function calls the message."""
        return parameters(self.function)[0]

    @property
    def python(self) -> str:
        """The function, as Python."""
        return ast.unparse(self.function)

    def machine(self, stream: Stream, flags: frozenset[str], lost: set[Ref]) -> Machine:
        """What follows the function at a message of a stream; what it finds to change from then on is added to `lost`.

        Raises `UnfollowableError` where the oracle may have called something else, or the function can't be followed.
        """
        name = "abstract_message"
        if not isinstance(self.constants.get(name), Function) or name in self.scope.changing:
            raise UnfollowableError
        check(self.function)
        return Machine(self.constants, self.initial, flags, self.scope.changing, self.scope, lost, stream, self.opaque)

    def start(self) -> State:
        """The state in which the function begins: it is called with the message alone."""
        function, args = self.constants["abstract_message"], self.function.args
        state = State(unbound(self.function))
        state.variables |= function.defaults if isinstance(function, Function) else {}
        state.variables |= {args.vararg.arg: Const(())} if args.vararg else {}
        state.variables |= {args.kwarg.arg: Const({})} if args.kwarg else {}
        state.variables[self.argument] = Message()
        return state


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
    state, scope = State({"__name__": Const(path.stem)}), read_scope(tree)
    machine = Machine(state.variables, scope=scope)
    for statement in tree.body:
        follow_top(statement, state, machine)
    formula, function = state.variables.get("PROPERTY"), state.variables.get("abstract_message")
    if formula is None:
        raise ConfigError(f"{path}: not a property module: it has no `PROPERTY = '…'`")
    if not isinstance(formula, Const) or not isinstance(formula.value, str):
        raise ConfigError(f"{path}: `PROPERTY` is not made of constants; write its text as `PROPERTY = '…'`")
    node = function.node if isinstance(function, Function) else next(_functions(tree), None)
    if node is None or not (node.args.posonlyargs or node.args.args):
        raise ConfigError(f"{path}: not a property module: it has no function `abstract_message(message)`")
    wanting = set(parameters(node)[1:]) - function.defaults.keys() if isinstance(function, Function) else set()
    if wanting:
        raise ConfigError(
            f"{path}:{node.lineno}: an oracle gives `abstract_message` the message alone: give a default to "
            f"`{'`, `'.join(sorted(wanting))}`"
        )
    kept = [*state.predicates.values(), *(state.variables[n] for n in scope.changing & state.variables.keys())]
    lost = machine.lost | state.lost | {ref for value in kept for ref in shared(value)}
    name = re.sub(r"[^A-Za-z0-9_.-]", "_", path.stem)[:64]
    return PropertyModule(
        name, " ".join(formula.value.split()), state.predicates, node, state.variables, scope, machine.opaque,
        frozenset(lost),
    )  # fmt: skip


def _functions(tree: ast.Module) -> Iterator[ast.FunctionDef]:
    """The functions `abstract_message` of a module that binds the name to something else in the end."""
    return (n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == "abstract_message")
