"""Parts of a formula with what their variables stand for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import Path
from oracle_server.core.formula.tree import Formula
from oracle_server.engines.native.build import Network
from oracle_server.engines.native.keys import Text

Values = Mapping[int, Text]
"""What each quantified variable stands for, None for any value that is not distinguished."""


@dataclass(frozen=True, slots=True)
class Part:
    """A part of the formula, where it stands, what binds its variables, and what they stand for."""

    formula: Formula
    path: Path
    scope: Mapping[str, int]
    values: Values

    def child(self, formula: Formula, place: int = 0) -> Part:
        """A part of this one, which no quantifier stands between."""
        return Part(formula, (*self.path, place), self.scope, self.values)

    def body(self, network: Network) -> Part:
        """The body of a quantifier, and of those of its kind that follow, with its variables bound."""
        formula, path, kind = self.formula, self.path, type(self.formula)
        while isinstance(formula, tree.Exists | tree.Forall) and type(formula) is kind:
            formula, path = formula.body, (*path, 0)
        return Part(formula, path, network.scopes[self.path], self.values)

    def given(self, values: Values) -> Part:
        """The same with these values too."""
        return Part(self.formula, self.path, self.scope, {**self.values, **values})


def is_simple(formula: Formula) -> bool:
    """Whether a formula needs no explanation but its truth: it is a word or an atom, negated or not."""
    if isinstance(formula, tree.Atom) or formula == tree.FIRST:
        return True
    return isinstance(formula, tree.Not) and is_simple(formula.operand)
