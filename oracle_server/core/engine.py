"""What an engine is: it is stepped through the judged events, and returns the outcome of its formula at each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol, TypeGuard, TypeVar, runtime_checkable

from oracle_server.core.atoms import Matches
from oracle_server.core.explanation import Why
from oracle_server.core.formula.tree import Exists, Forall, Formula, Historically, Once
from oracle_server.core.past import NO_PAST, Past
from oracle_server.core.verdicts import Outcome

MAX_WORK = 50_000
"""Values, or combinations of them, that a native engine may look at for one step, or for the ticks between two."""
MAX_WORK_ON_AVERAGE = 5_000
"""The same for a step, over many of them."""
MAX_WORK_TOGETHER = 75_000
"""The same for one step of all properties of a session, some 40 ms; for the ticks between two it is `MAX_WORK`."""


T = TypeVar("T")
_PROVIDED: dict[tuple[type, type], bool] = {}


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
    """An engine that can take steps back, and so compute hypothetical outcomes."""

    def mark(self) -> None:
        """Save the present state, until `back` or `keep`."""
        ...

    def back(self) -> None:
        """Take back all steps since `mark`."""
        ...

    def keep(self) -> None:
        """Keep the steps since `mark`."""
        ...

    def next_deadline(self, after: int) -> int | None:
        """The first time (ns) later than `after` at which the outcome may change without a step, None for never."""
        ...


@runtime_checkable
class Rewindable(Revisable, Protocol):
    """An engine that can go back to any of its last steps, once it was told to `record` what that takes."""

    def record(self) -> None:
        """From now on, keep what is needed to go back."""
        ...

    def rewind(self, step: int, time: int, before: int) -> None:
        """Go back to a step, as it was after it: by its number, 0 for the beginning, its time (ns) and the last one's.

        No mark may be open, and no later step may be one that was forgotten.
        """
        ...

    def forget(self, step: int, time: int) -> None:
        """Keep no more than is needed to go back to a step, by its number and time (ns)."""
        ...


def provides(engine: Engine, protocol: type[T]) -> TypeGuard[T]:
    """Whether an engine is of a protocol, found once for all of its class: Python 3.11 takes 30 µs for that."""
    key = type(engine), protocol
    found = _PROVIDED.get(key)
    if found is None:
        found = _PROVIDED[key] = isinstance(engine, protocol)
    return found


def rewindable(engine: Engine) -> Rewindable:
    """An engine of a spec that revises."""
    assert provides(engine, Rewindable)  # noqa: S101 -- others are refused with the spec
    return engine


@runtime_checkable
class Bounded(Engine, Protocol):
    """An engine that counts what it looks at."""

    @property
    def work(self) -> int:
        """How many values it looked at for the last step."""
        ...

    def allow(self, work: int) -> None:
        """Let it look at so many for a step from now on, where that is less than what one may cost by itself."""
        ...


@runtime_checkable
class Savable(Engine, Protocol):
    """An engine whose state can be saved, and restored in another one."""

    def snapshot(self) -> dict[str, Any]:
        """All that later verdicts depend on, as plain data that JSON can represent."""
        ...

    def restore(self, data: Mapping[str, Any]) -> None:
        """Continue from a snapshot, before the first step. Raises `EngineError` where it can't be used."""
        ...


@runtime_checkable
class Explaining(Engine, Protocol):
    """An engine that can explain its outcome."""

    def explain(self, past: Past = NO_PAST) -> Why:
        """Why the formula holds, or does not, at the last step, as far back as the remembered steps go."""
        ...


class Answer(NamedTuple):
    """The answer of an external oracle to a step: an outcome, and its reply as text, or why there is none.

    `anew`: it was asked on a new connection, and may have lost its state.
    """

    outcome: Outcome
    text: str
    anew: bool = False


@runtime_checkable
class Receiving(Engine, Protocol):
    """An engine that receives the answer of an external oracle before each step."""

    def receive(self, answer: Answer) -> None:
        """Use an answer for the next step."""
        ...


@runtime_checkable
class Measuring(Engine, Protocol):
    """An engine that measures how far its formula is from changing its truth."""

    @property
    def robustness(self) -> float | None:
        """Above 0 where the formula held at the last step, below where it did not, None where that is not known."""
        ...

    @property
    def begun(self) -> bool:
        """Whether a step has had all that the formula reads: before, nothing is known, and nothing missed."""
        ...


def outcome(formula: Formula, holds: bool) -> Outcome:
    """The outcome of a formula that holds or does not, final in the two plain cases.

    An unbounded `historically` that failed stays false and an unbounded `once` that held stays true, also under
    quantifiers: a new value had the truth of all values that were not seen yet.
    """
    while isinstance(formula, Exists | Forall):
        formula = formula.body
    match formula:
        case Historically(_, bound) if bound.upper is None and not holds:
            return Outcome.FALSE
        case Once(_, bound) if bound.upper is None and holds:
            return Outcome.TRUE
    return Outcome.CURRENTLY_TRUE if holds else Outcome.CURRENTLY_FALSE


class Broken:
    """Replaces an engine that failed, to free its memory; `complaint` is what that engine reported."""

    def __init__(self, complaint: str | None) -> None:
        self.complaint = complaint

    def step(self, time: int, matches: Matches) -> Outcome:  # noqa: ARG002
        """No judgement."""
        return Outcome.UNKNOWN
