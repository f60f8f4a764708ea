"""What is known at a statement of a function, and what has changed since: who has a list may change it.

One rule says what may still be read: a value whose lists, dicts and fields nobody had that may have changed them.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from oracle_server.specfiles.rosmonitoring.scope import Scope
from oracle_server.specfiles.rosmonitoring.streams import Stream
from oracle_server.specfiles.rosmonitoring.values import (
    Const,
    Field,
    Message,
    Predicates,
    Ref,
    UnfollowableError,
    Value,
    shared,
)


@dataclass(slots=True)
class State:
    """Variables, what the predicates that were assigned are worth, the function around, and where this one failed.

    `lost` is what code elsewhere may have changed since the function began.
    """

    variables: dict[str, Value] = field(default_factory=dict)
    predicates: dict[str, Value] = field(default_factory=dict)
    around: State | None = None
    fails: Value = field(default_factory=lambda: Const(None))
    lost: frozenset[Ref] = frozenset()

    def copy(self) -> State:
        """The same values, which change by themselves."""
        return State(dict(self.variables), dict(self.predicates), self.around, self.fails, self.lost)

    def owner(self, name: str) -> State | None:
        """Where a variable is found: here, in a function around this one, or nowhere."""
        state: State | None = self
        while state is not None and name not in state.variables:
            state = state.around
        return state


class Module(Protocol):
    """What expressions need of the module around them; `statements.Machine` is one."""

    constants: Mapping[str, Value]
    initial: Mapping[str, Value]
    flags: frozenset[str]
    lost: set[Ref]
    scope: Scope
    stream: Stream | None

    def find(self, name: str, state: State) -> Value | None:
        """What a name stands for, None where the module does not bind it. Raises `UntranslatableError`."""
        ...

    def call(self, name: str, node: ast.Call, state: State) -> Value:
        """What a call of a function of the module is worth. Raises `UntranslatableError`."""
        ...

    def assign(self, target: ast.expr, value: Value, state: State) -> None:
        """Bind a name to a value. Raises `UntranslatableError`."""
        ...


def lose(refs: Iterable[Ref], state: State, machine: Module) -> None:
    """Note what code elsewhere may change: of the module's own for every message, of others from here on.

    Raises `UnfollowableError` where that is `predicates`.
    """
    found = set(refs)
    if Predicates() in found:
        raise UnfollowableError
    if machine.stream is not None and machine.stream.kind != "topic" and any(isinstance(r, Field) for r in found):
        found.add(Message())  # it holds the fields under a key of its own
    state.lost |= found
    keep(found, machine)


def keep(refs: Iterable[Ref], machine: Module) -> None:
    """Note what of the module's own may have changed at the next message."""
    if found := set(refs):
        machine.lost |= found & {ref for value in machine.constants.values() for ref in shared(value)}


def is_lost(value: Value, state: State, machine: Module) -> bool:
    """Whether a value may have changed since it was made."""
    lost = state.lost | machine.lost
    if not lost:
        return False
    found = set(shared(value))
    return bool(found & lost) or (Message() in lost and any(isinstance(ref, Field) for ref in found))
