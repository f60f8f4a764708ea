"""What each part of a formula comes to at the present step, for those who look at them over time."""

from __future__ import annotations

from collections.abc import Sequence

from oracle_server.core.atoms import Matches
from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import Path
from oracle_server.core.formula.outline import Row, free
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.tree import Formula
from oracle_server.core.verdicts import Outcome
from oracle_server.engines.native.guarding import GuardingEngine


class WatchedEngine(GuardingEngine):
    """A native engine that is asked at each step for the truth of some parts of its formula."""

    def __init__(self, formula: Formula, time: Time, rows: Sequence[Row], *, guards: bool = False) -> None:
        """`rows` are the parts that are asked for; `guards`: it decides events."""
        super().__init__(formula, time, guards=guards)
        self._rows = [(row.part, row.path) if row.is_told else None for row in rows]
        self.watching = range(0)
        """The times (ns) of the steps at which it is asked."""
        self.outcome: Outcome | None = None
        """The outcome of the last of these steps, None where there was none since this was set to None."""
        self.at = 0
        """The time of that step (ns)."""
        self.truths: list[bool | None] = []
        """Whether each part held at that step, None where that can't be told."""

    def step(self, time: int, matches: Matches) -> Outcome:
        """Judge the next step, and look at the parts."""
        outcome = super().step(time, matches)
        if time in self.watching:
            self.outcome, self.at = outcome, time
            self.truths = [None if row is None else self._at(*row) for row in self._rows]
        return outcome

    def _at(self, part: Formula, path: Path) -> bool | None:
        """Whether a part without free variables holds now: what is Boolean stands between the nodes."""
        match part:
            case tree.Not(operand):
                value = self._at(operand, (*path, 0))
                return None if value is None else not value
            case tree.And(left, right):
                return self._joined(left, right, path, absorbing=False)
            case tree.Or(left, right):
                return self._joined(left, right, path, absorbing=True)
            case tree.Implies(left, right):
                sides = self._at(left, (*path, 0)), self._at(right, (*path, 1))
                return True if sides[0] is False or sides[1] is True else None if None in sides else False
        node = self._network.places.get(path)
        if node is None:
            within = isinstance(part, tree.Exists | tree.Forall) and not free(part.body)
            return self._at(tree.children(part)[0], (*path, 0)) if within else None
        value = node.at(())
        return not value if isinstance(part, tree.Historically | tree.Forall) else value

    def _joined(self, left: Formula, right: Formula, path: Path, *, absorbing: bool) -> bool | None:
        sides = self._at(left, (*path, 0)), self._at(right, (*path, 1))
        return absorbing if absorbing in sides else None if None in sides else not absorbing
