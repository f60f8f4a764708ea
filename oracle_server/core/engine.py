"""What every engine is: something that is stepped through the judged events and says how its formula stands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol, runtime_checkable

from oracle_server.core.atoms import Matches
from oracle_server.core.explanation import Why
from oracle_server.core.formula.tree import Exists, Forall, Formula, Historically, Once
from oracle_server.core.past import NO_PAST, Past
from oracle_server.core.verdicts import Outcome

MAX_WORK = 50_000
"""Values, or combinations of them, that an engine of ours may look at for one step, or for the ticks between two."""
MAX_WORK_ON_AVERAGE = 5_000
"""The same for a step, over many of them."""


class Engine(Protocol):
    """The state of one formula in one session."""

    def step(self, time: int, matches: Matches) -> Outcome:
        """Judge the next step.

        `time` is the step's time in nanoseconds, never less than the one before; `matches` has an entry for each
        atom of the formula, in the order of `tree.atoms`. Raises `EngineError` where it can't judge any more.
        """
        ...


@runtime_checkable
class Revisable(Engine, Protocol):
    """An engine that can take steps back, and so tell what would be."""

    def mark(self) -> None:
        """Remember how all stands, until `back` or `keep`."""
        ...

    def back(self) -> None:
        """Take back all steps since `mark`."""
        ...

    def keep(self) -> None:
        """Let the steps since `mark` stand."""
        ...

    def next_deadline(self, after: int) -> int | None:
        """The first time (ns) later than `after` at which the outcome may change without a step, None for never."""
        ...


@runtime_checkable
class Savable(Engine, Protocol):
    """An engine that can be saved, and go on elsewhere."""

    def snapshot(self) -> dict[str, Any]:
        """All that later verdicts depend on, as plain data that JSON can carry."""
        ...

    def restore(self, data: Mapping[str, Any]) -> None:
        """Go on, before the first step, where a snapshot was taken. Raises `EngineError` where it can't be used."""
        ...


@runtime_checkable
class Explaining(Engine, Protocol):
    """An engine that can say why."""

    def explain(self, past: Past = NO_PAST) -> Why:
        """Why the formula holds, or does not, at the last step, as deep as the remembered steps tell."""
        ...


class Answer(NamedTuple):
    """What an oracle elsewhere says of a step: an outcome, and in what words, or why there are none.

    `anew`: it was asked on a new connection, and may have begun anew.
    """

    outcome: Outcome
    said: str
    anew: bool = False


@runtime_checkable
class Told(Engine, Protocol):
    """An engine that is told what an oracle elsewhere says of the next step."""

    def tell(self, answer: Answer) -> None:
        """Take in what is said of the next step."""
        ...


@runtime_checkable
class Measuring(Engine, Protocol):
    """An engine that can say how far its formula is from changing its truth."""

    @property
    def robustness(self) -> float | None:
        """Above 0 where the formula held at the last step, below where it did not, None where that is not known."""
        ...


def outcome(formula: Formula, holds: bool) -> Outcome:
    """The outcome of a formula that holds or does not, final in the two plain cases.

    An unbounded `historically` that failed can't mend and an unbounded `once` that held can't break, and no
    quantifier before them changes that: a new value was among the ones not seen yet, and stood as they did.
    """
    while isinstance(formula, Exists | Forall):
        formula = formula.body
    match formula:
        case Historically(_, bound) if bound.upper is None and not holds:
            return Outcome.FALSE
        case Once(_, bound) if bound.upper is None and holds:
            return Outcome.TRUE
    return Outcome.CURRENTLY_TRUE if holds else Outcome.CURRENTLY_FALSE
