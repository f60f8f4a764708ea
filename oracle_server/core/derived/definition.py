"""What a spec says of a derived signal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Literal, NamedTuple

from oracle_server.core.expression import Expression, parse_expression
from oracle_server.core.formula.tree import Any, Atom, Constraint, Formula, atoms

Op = Literal[
    "expression", "count", "rate", "sum", "mean", "min", "max", "last", "previous", "delta", "age"
]  # fmt: skip
MAX_SAMPLES = 100_000
"""Samples that all windows of a session may hold."""
MAX_KEYS = 10_000
"""Keys that one signal may have."""
MAX_DERIVED = 1_000
"""Derived signals that a spec may have."""


class Traits(NamedTuple):
    """What sets an operation apart: its operand is a `formula`, or else a signal; it is taken over a `window`.

    `numbers`: samples that are no numbers fail; `lasting`: what it says of a key stays until the key is forgotten.
    """

    formula: bool = False
    window: bool = False
    numbers: bool = True
    lasting: bool = False


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
    }
)
"""The operations, by the keys that specs have for them."""


@dataclass(frozen=True)
class Definition:
    """A derived signal: `op` of the formula, signal or expression `of`.

    `over` is its window: nanoseconds, or where `counted` samples, of a formula steps. `by` names the signal whose
    values are told apart, empty for none; a value is forgotten `forget` ns after its last sample, None for never.
    """

    name: str
    op: Op
    of: str
    formula: Formula | None = None
    over: int | None = None
    counted: bool = False
    by: str = ""
    forget: int | None = None

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
        """The signals that it is computed of, each once."""
        if self.formula is not None:
            keys = [c.key for atom in atoms(self.formula) for c in atom.constraints]
            return tuple(dict.fromkeys(keys))
        if self.op == "expression":
            return self.expression.signals
        return (self.of,)

    @property
    def reads(self) -> tuple[str, ...]:
        """All signals that matter to it."""
        return (*self.operands, self.by) if self.by else self.operands

    @cached_property
    def atoms(self) -> tuple[Atom, ...]:
        """What it reads, as atoms: those of its formula come first."""
        own = atoms(self.formula) if self.formula is not None else ()
        names = self.reads if not own else (self.by,) if self.by else ()
        return (*own, *(Atom((Constraint(name, "==", Any.ANY),)) for name in names))
