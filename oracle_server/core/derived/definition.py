"""What a spec says of a derived signal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Literal, NamedTuple

from oracle_server.core.expression import Expression, certain, parse_expression
from oracle_server.core.formula.tree import Any, Atom, Constraint, Formula, atoms
from oracle_server.core.machines.table import Table

Op = Literal[
    "expression", "count", "rate", "sum", "mean", "min", "max", "last", "previous", "delta", "age",
    "states", "follows", "sequence",
]  # fmt: skip
MAX_SAMPLES = 100_000
"""Samples that all windows of a session may hold."""
MAX_KEYS = 10_000
"""Keys that one signal may have."""
MAX_MACHINES = 100_000
"""The same of one whose value is the state of a machine."""
MAX_PARAMETRIC = 1_000
"""The same where several signals tell machines apart: one event may move all of them, and each change is noted."""
MAX_DERIVED = 1_000
"""Derived signals that a spec may have."""


class Traits(NamedTuple):
    """What sets an operation apart: its operand is a `formula`, or else a signal; it is taken over a `window`.

    `numbers`: samples that are no numbers fail; `lasting`: what it says of a key stays until the key is forgotten;
    `machine`: it is the state of a machine.
    """

    formula: bool = False
    window: bool = False
    numbers: bool = True
    lasting: bool = False
    machine: bool = False


OPS: Mapping[Op, Traits] = MappingProxyType(
    {
        "count": Traits(formula=True, window=True),
        "rate": Traits(formula=True, window=True),
        "sum": Traits(window=True),
        "mean": Traits(window=True),
        "min": Traits(window=True),
        "max": Traits(window=True),
        "last": Traits(numbers=False, lasting=True),
        "previous": Traits(numbers=False, lasting=True),
        "delta": Traits(lasting=True),
        "age": Traits(formula=True, lasting=True),
        "states": Traits(machine=True, numbers=False, lasting=True),
        "follows": Traits(machine=True, numbers=False, lasting=True),
        "sequence": Traits(machine=True, numbers=False, lasting=True),
    }
)
"""The operations, by the keys that specs have for them."""


@dataclass(frozen=True)
class Definition:
    """A derived signal: `op` of the formula, signal or expression `of`.

    `over` is its window: nanoseconds, or where `counted` samples, of a formula steps. `by` names the signals whose
    values are told apart, none where it is one for all: of a machine several, of all else one at most. A value is
    forgotten `forget` ns after its last sample, None for never. A machine has its `table`, and but for one that follows
    a signal a formula for each of its `events`.
    """

    name: str
    op: Op
    of: str
    formula: Formula | None = None
    over: int | None = None
    counted: bool = False
    by: tuple[str, ...] = ()
    forget: int | None = None
    table: Table | None = None
    events: tuple[Formula, ...] = ()

    @property
    def timed(self) -> bool:
        """Whether it is over a window of time."""
        return self.over is not None and not self.counted

    @property
    def changes(self) -> bool:
        """Whether time alone changes it: samples leave its window, or it is an age."""
        return self.timed or self.op == "age"

    @cached_property
    def expression(self) -> Expression:
        """The expression that it is. Raises `ExpressionError` where it can't be read."""
        return parse_expression(self.of, signals=True)

    @cached_property
    def operands(self) -> tuple[str, ...]:
        """The signals that it is computed of, each once; those of its formulas, where it has any."""
        if self.formulas:
            return tuple(dict.fromkeys(c.key for atom in self.tested for c in atom.constraints))
        if self.op == "expression":
            return self.expression.signals
        return (self.of,)

    @property
    def formulas(self) -> tuple[Formula, ...]:
        """The formulas that it reads: that of an operation, or those of a machine's events."""
        return self.events if self.formula is None else (self.formula,)

    @cached_property
    def tested(self) -> tuple[Atom, ...]:
        """The different atoms of its formulas."""
        return tuple(dict.fromkeys(atom for formula in self.formulas for atom in atoms(formula)))

    @cached_property
    def needed(self) -> tuple[str, ...]:
        """The signals without any of which it is absent; where it is kept by several, without all of these."""
        if self.op == "expression":
            return tuple(certain(self.expression.tree))
        return (*self.by, self.of) if self.op in ("previous", "delta") else self.by

    @property
    def reads(self) -> tuple[str, ...]:
        """All signals that matter to it."""
        return (*self.operands, *self.by)

    @cached_property
    def atoms(self) -> tuple[Atom, ...]:
        """What it reads, as atoms: those of its formula come first."""
        names = self.reads if not self.formulas else self.by
        return (*self.tested, *(Atom((Constraint(name, "==", Any.ANY),)) for name in names))
