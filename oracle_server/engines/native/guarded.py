"""`exists` over a body that holds only where an atom does, as in `forall[x]. ({…, k: *x} -> …)`: one key to look at."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from functools import partial
from typing import Any

from oracle_server.engines.native.body import Body
from oracle_server.engines.native.expressions import Expression
from oracle_server.engines.native.keys import Key, Region, Variables, read_key
from oracle_server.engines.native.nodes import AtomNode
from oracle_server.engines.native.some import settled_over
from oracle_server.engines.native.timeline import Timeline


class SomeGuarded:
    """A quantifier that binds all variables of its body, one conjunct of which is an atom with all of them."""

    __slots__ = ("_body", "_guard", "_operand", "_timeline", "changes", "flat", "held", "variables")
    binds: frozenset[int] = frozenset()
    multiplies = lasting = False

    def __init__(self, guard: AtomNode, operand: Expression, timeline: Timeline) -> None:
        self._guard, self._timeline = guard, timeline
        self._body = Body(timeline, operand)
        self._operand = self._body.at[0]
        self.variables: Variables = ()
        self.flat = True
        self.changes: list[Key] = []
        self.held: list[Key] = []
        """The key at which the body holds, where it does."""

    def at(self, key: Key) -> bool:  # noqa: ARG002 -- it has one value
        """The value."""
        return bool(self.held)

    def step(self) -> None:
        """Look again: nowhere else can the body hold."""
        guard, before = self._guard, self.held
        if self.changes:
            self.changes = []
        held = [guard.current] if guard.holds and self._operand(guard.current) else []
        if held == before:
            return
        if self._timeline.journal is not None:
            self._timeline.journal.append(partial(setattr, self, "held", before))
        self.held = held
        if bool(held) is not bool(before):
            self.changes = [()]

    def due(self) -> int | None:
        """Never by itself: while the atom holds, each step is looked at."""
        return None

    def next_deadline(self, after: int) -> int | None:  # noqa: ARG002
        """None: time alone changes nothing."""
        return None

    def points(self) -> Collection[Key]:
        """None: it has one value."""
        return ()

    def spread(self, region: Region, place: int) -> Collection[str]:  # noqa: ARG002 -- as at every node
        """None: it has one value."""
        return ()

    def constant(self, region: Region) -> bool | None:  # noqa: ARG002
        """The value."""
        return bool(self.held)

    def index(self) -> None:
        """Nothing to prepare."""

    def keys(self, key: Key) -> Collection[Key]:  # noqa: ARG002
        """The key of the body's variables at which it holds."""
        return self.held

    @property
    def body_variables(self) -> Variables:
        """The variables of `keys`."""
        return self._guard.variables

    def snapshot(self) -> Any:
        """The state as plain data."""
        return self.held

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        self.held = [read_key(key) for key in data]

    def apart(self, variable: int) -> Iterator[str]:  # noqa: ARG002
        """None: it has one value."""
        return iter(())

    def settled(self, key: Key) -> bool | None:  # noqa: ARG002
        """False where the body has settled so at all keys; true never, since the next step may be any."""
        return None if self.held else settled_over(self._body, ())

    def can_settle(self, fresh: frozenset[int]) -> tuple[bool, bool]:
        """Whether the value can settle on true, and on false, where these variables have fresh values."""
        return False, self._body.can_settle[0](fresh.union(self._body.variables))[1]


def guard_of(expression: Expression, variables: Variables) -> AtomNode | None:
    """An atom with all of these variables that must hold wherever an expression does, None where there is none."""
    if isinstance(expression, AtomNode):
        return expression if expression.variables == variables else None
    if not isinstance(expression, tuple) or expression[0] != "and":
        return None
    return guard_of(expression[1], variables) or guard_of(expression[2], variables)
