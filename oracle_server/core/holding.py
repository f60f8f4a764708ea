"""Held signals: the last values that later events of the same monitor have too."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from oracle_server.core.events import Step
from oracle_server.core.formula.tree import Scalar


@dataclass(slots=True)
class Held:
    """The last values of one monitor's held signals; `failed` are those whose last value is not known."""

    values: dict[str, Scalar] = field(default_factory=dict)
    failed: set[str] = field(default_factory=set)

    def copy(self) -> Held:
        """The same values, which change by themselves."""
        return Held(dict(self.values), set(self.failed))

    def take(self, names: frozenset[str], step: Step) -> None:
        """Hold these signals of a step; one that the step lacks is held no more."""
        self.failed = (self.failed - names) | (names & step.failed)
        for name in names:
            self.values.pop(name, None)
            if name in step.signals:
                self.values[name] = step.signals[name]


def together(monitors: Iterable[Held]) -> tuple[dict[str, Scalar], set[str]]:
    """The values that some monitors hold, and the signals that failed; of several that hold one, the last counts."""
    values: dict[str, Scalar] = {}
    failed: set[str] = set()
    for held in monitors:
        values |= held.values
        failed = (failed - held.values.keys()) | held.failed
    return {k: v for k, v in values.items() if k not in failed}, failed
