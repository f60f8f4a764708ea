"""The engine around the nodes of a formula: it steps them, and takes steps back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from oracle_server.core.atoms import Matches
from oracle_server.core.errors import EngineError
from oracle_server.core.explanation import Why
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.tree import Formula
from oracle_server.core.past import NO_PAST, Past
from oracle_server.core.verdicts import Outcome
from oracle_server.engines.native.build import build
from oracle_server.engines.native.explain import explain
from oracle_server.engines.native.timeline import Timeline

_NEVER = 2**63
FORMAT = 2
"""The number of the form that snapshots have."""


class NativeEngine:
    """The state of one formula in one session."""

    def __init__(self, formula: Formula, time: Time = "steps", share: float = 1) -> None:
        """`share` is the part of an engine's cost limit that this one may use: many engines share it."""
        self._formula, self._time = formula, time
        self._timed = time == "seconds"
        self._timeline = Timeline(timed=self._timed, share=share)
        network = self._network = build(formula, self._timeline)
        self._atoms, self._operators = network.atoms, network.operators
        (self._holds,), (self._settled,) = network.root.at, network.root.settled
        self._can_settle = any(network.root.can_settle[0](frozenset()))
        self._journals: list[list[Callable[[], object]]] = []
        self._steps = 0
        self._due = 0
        """When something may change although no atom does: a step's number, or nanoseconds."""
        self._last: Outcome = Outcome.UNKNOWN

    def step(self, time: int, matches: Matches) -> Outcome:
        """Judge the next step; see `Engine.step`."""
        self._steps += 1
        now = time if self._timed else self._steps
        self._timeline.move(now)
        silent = matches.count(None) == len(matches)
        if silent and now < self._due:
            return self._last
        for place, atom in self._atoms:
            match = matches[place]
            if match is not None or not atom.idle:
                atom.take(match)
        for operator in self._operators:
            operator.step()
        self._timeline.first = False
        self._due = self._next_due() if silent else 0
        self._last = self._outcome()
        return self._last

    def _outcome(self) -> Outcome:
        holds = self._holds(())
        if self._can_settle and self._settled(()) is holds:
            return Outcome.TRUE if holds else Outcome.FALSE
        return Outcome.CURRENTLY_TRUE if holds else Outcome.CURRENTLY_FALSE

    def next_deadline(self, after: int) -> int | None:
        """The first time (ns) later than `after` at which the outcome may change without a step, None for never."""
        if not self._timed or self._timeline.first:
            return None
        deadlines = [d for operator in self._operators if (d := operator.next_deadline(after)) is not None]
        return min(deadlines, default=None)

    @property
    def work(self) -> int:
        """What the last step cost, in values that were looked at."""
        return self._timeline.work

    def allow(self, work: int) -> None:
        """Let it look at so many values for a step; see `Bounded.allow`."""
        self._timeline.allowed = work

    def explain(self, past: Past = NO_PAST) -> Why:
        """Why the formula holds, or does not, at the last step; see `Explaining.explain`."""
        return explain(self._formula, self._network, self._time, self._steps, past)

    def snapshot(self) -> dict[str, Any]:
        """All that later verdicts depend on, as plain data that JSON can represent."""
        nodes = [*(atom for _, atom in self._atoms), *self._operators]
        return {
            "format": FORMAT,
            "clock": self._timeline.snapshot(),
            "nodes": [node.snapshot() for node in nodes],
            "steps": self._steps,
            "due": self._due,
            "last": self._last.value,
        }

    def restore(self, data: Mapping[str, Any]) -> None:
        """Continue from a snapshot of the same formula, before the first step.

        Raises `EngineError` where it was taken by a version that keeps other things.
        """
        if data.get("format") != FORMAT:
            raise EngineError(f"a snapshot of format {data.get('format')}, and this version reads {FORMAT}")
        self._timeline.restore(data["clock"])
        nodes = [*(atom for _, atom in self._atoms), *self._operators]
        for node, state in zip(nodes, data["nodes"], strict=True):
            node.restore(state)
        self._steps, self._due, self._last = data["steps"], data["due"], Outcome(data["last"])

    def mark(self) -> None:
        """Record all changes from now on, until `back` or `keep`; marks can be nested."""
        steps, due, last = self._steps, self._due, self._last
        atoms = [(atom, atom.current) for _, atom in self._atoms]

        def back() -> None:
            self._steps, self._due, self._last = steps, due, last
            for atom, current in atoms:
                atom.current = current

        self._journals.append([back])
        self._timeline.journal = self._journals[-1]

    def back(self) -> None:
        """Take back all steps since the last mark."""
        for undo in reversed(self._close()):
            undo()

    def keep(self) -> None:
        """Keep the steps since the last mark."""
        journal = self._close()
        if self._timeline.journal is not None:
            self._timeline.journal += journal

    def _close(self) -> list[Callable[[], object]]:
        journal = self._journals.pop()
        self._timeline.journal = self._journals[-1] if self._journals else None
        return journal

    def _next_due(self) -> int:
        deadlines = [due for operator in self._operators if (due := operator.due()) is not None]
        return min(deadlines, default=_NEVER)
