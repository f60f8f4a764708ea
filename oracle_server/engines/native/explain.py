"""Why a formula holds or does not at the last step.

A conjunction that fails is explained by one side that does, one that holds by both; a temporal operator by the steps
that decide it, and its operand at these in turn, as far as they are remembered; and so on down to atoms. What is
explained at several steps at once is explained once.
"""

from __future__ import annotations

from msgspec import structs

from oracle_server.core.explanation import Reason, Why
from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Formula
from oracle_server.core.past import Past
from oracle_server.engines.native.build import Network
from oracle_server.engines.native.deciding import Steps
from oracle_server.engines.native.guarded import SomeGuarded
from oracle_server.engines.native.keys import key_of, texts_of
from oracle_server.engines.native.lookback import LookingBack
from oracle_server.engines.native.parts import Part
from oracle_server.engines.native.reasons import leaves, size, spots
from oracle_server.engines.native.recall import Recall
from oracle_server.engines.native.some import Some, SomeOf
from oracle_server.engines.native.sought import SomeSought
from oracle_server.engines.native.wording import Wording, scalar

_MOST_STEPS = 2_000
A_PART = 50
"""What a part of the formula costs, in the effort that the past is looked through with."""
_STEP = render(tree.STEP)
_MOST_TOLD = 3
"""Values that are shown where all decide together."""


def explain(formula: Formula, network: Network, time: Time, last: int, past: Past) -> Why:
    """Why the formula holds, or does not, at the last step, number `last`; `past` are the remembered steps."""
    recall = Recall(formula, network, time, last, past)
    try:
        return _explain(formula, network, time, recall)
    finally:
        if past.spent is not None:
            past.spent(recall.spent + A_PART * (len(network.atoms) + len(network.operators)))


def _explain(formula: Formula, network: Network, time: Time, recall: Recall) -> Why:
    part, last = Part(formula, (), {}, {}), recall.last
    explainer = Explainer(network, recall, Wording(time, network.timeline.now, recall))
    holds = explainer.holds(part)
    deciding = None
    if isinstance(formula, tree.Exists | tree.Forall) and holds is isinstance(formula, tree.Exists):
        deciding = explainer.deciding(part)
    if deciding is None:
        return Why(holds, {}, 0, tuple(explainer.reasons(part, holds, [last])))
    inner, others = deciding
    values = {name: scalar(inner.values[i]) for name, i in inner.scope.items() if i in inner.values}
    return Why(holds, values, others, tuple(explainer.reasons(inner, explainer.holds(inner), [last])))


class Explainer(LookingBack):
    """Finds the reasons of all parts but of those that wait for what comes."""

    def reasons(self, part: Part, holds: bool, steps: Steps) -> list[Reason]:
        """What decides that a part holds at all of some steps, or at none of them."""
        if len(steps) > _MOST_STEPS or part.formula in (tree.FIRST, tree.FALSE):
            return [self._plain(part, steps, holds)]
        if isinstance(part.formula, tree.Relation):
            return [self._reason(part, [self._now], holds, "holds" if holds else "does not hold")]
        found = self._deciding_parts(part, steps, holds)
        if part.formula.written is None or isinstance(part.formula, tree.Atom):
            return found
        if isinstance(part.formula, tree.Not | tree.And | tree.Or | tree.Implies):
            return [self._named(part, steps, holds, found)]
        return [structs.replace(reason, told=True) for reason in found]

    def stood(self, part: Part, steps: Steps, *, holds: bool) -> Reason:
        """That a part held at all of some steps, or at none of them, without its reasons."""
        return self._plain(part, steps, holds)

    def _named(self, part: Part, steps: Steps, holds: bool, found: list[Reason]) -> Reason:
        """That a part with a name held, or did not, and why."""
        now = "holds" if holds else "does not hold"
        text = now if [*steps] == [self._now] else "held" if holds else "did not hold"
        return self._reason(part, steps, holds, text, parts=tuple(found), told=True)

    def _deciding_parts(self, part: Part, steps: Steps, holds: bool) -> list[Reason]:  # noqa: PLR0911 -- a case a node
        match part.formula:
            case tree.Not(operand):
                return self.reasons(part.child(operand), not holds, steps)
            case tree.And(left, right):
                sides = [(part.child(left), holds), (part.child(right, 1), holds)]
                return self._all(sides, steps) if holds else self._one(part, holds, sides, steps)
            case tree.Or(left, right):
                sides = [(part.child(left), holds), (part.child(right, 1), holds)]
                return self._one(part, holds, sides, steps) if holds else self._all(sides, steps)
            case tree.Implies(left, right):
                sides = [(part.child(left), not holds), (part.child(right, 1), holds)]
                return self._one(part, holds, sides, steps) if holds else self._all(sides, steps)
            case tree.Exists() | tree.Forall():
                return self._quantifier(part, steps, holds)
            case tree.Atom():
                return [self._plain(part, steps, holds)]
            case tree.Pre(operand):
                return [self._pre(part, part.child(operand), steps, holds)]
            case tree.Since():
                return [self._since(part, steps, holds)]
            case tree.Once() | tree.Historically():
                return [self._once(part, steps, holds)]
            case _:
                raise AssertionError(part.formula)  # what waits for what comes is explained by its obligations

    def deciding(self, part: Part) -> tuple[Part, int] | None:
        """A quantifier's body with values that decide it now, and how many others do; None where all do together."""
        node = self._network.places.get(part.path)
        if not isinstance(node, Some | SomeOf | SomeGuarded | SomeSought):
            return None
        own = key_of([part.values.get(v) for v in node.variables])
        keys = node.keys(own)
        if not keys:
            return None
        first = min(keys, key=lambda key: [(text is None, text or "") for text in texts_of(key)])
        found = dict(zip(node.body_variables, texts_of(first), strict=True))
        return part.body(self._network).given(found), len(keys) - 1

    def _all(self, sides: list[tuple[Part, bool]], steps: Steps) -> list[Reason]:
        """The reasons of all sides; that it is a step at all is none where there are others."""
        found = [reason for side, holds in sides for reason in self.reasons(side, holds, steps)]
        return [reason for reason in found if reason.formula != _STEP] or found

    def _one(self, part: Part, holds: bool, sides: list[tuple[Part, bool]], steps: Steps) -> list[Reason]:
        """The reasons of one side, the shorter ones; of both, where each decides at some of the steps."""
        found = [[s for s in steps if self._recall.at(side, s) is value] for side, value in sides]
        alone = [self.reasons(*side, steps) for side, held in zip(sides, found, strict=True) if len(held) == len(steps)]
        if alone:
            return min(alone, key=size)
        rest = sorted({*steps}.difference(found[0]))
        if not {*rest}.issubset(found[1]):
            return [self._plain(part, steps, holds)]
        return [*self.reasons(*sides[0], found[0]), *self.reasons(*sides[1], rest)]

    def _quantifier(self, part: Part, steps: Steps, holds: bool) -> list[Reason]:
        if holds is not isinstance(part.formula, tree.Exists):
            return [self._for_all(part, steps, holds)]
        if [*steps] == [self._now]:
            deciding = self.deciding(part)
            groups = None if deciding is None else [(*deciding, steps)]
        else:
            groups = self._groups(part, steps, holds)
        if groups is None:
            return [self._plain(part, steps, holds)]
        reasons = []
        for body, others, group in groups:
            given = f"for {self._wording.values(body.scope, body.values)}" + (f" (and {others} more)" if others else "")
            parts = tuple(self.reasons(body, holds, group))
            reasons.append(self._reason(part, group, holds, given, parts=parts))
        return reasons

    def _groups(self, part: Part, steps: Steps, holds: bool) -> list[tuple[Part, int, Steps]] | None:
        """A quantifier's body with values that decide it, and the steps where they do; None where that is not known."""
        groups: list[tuple[Part, int, Steps]] = []
        bodies, rest = self._recall.bindings(part) or [], [*steps]
        while rest:
            body = next((b for b in bodies if self._recall.at(b, rest[0]) is holds), None)
            if body is None:
                return None
            groups.append((body, 0, [s for s in rest if self._recall.at(body, s) is holds]))
            rest = sorted({*rest}.difference(groups[-1][2]))
        return groups

    def _for_all(self, part: Part, steps: Steps, holds: bool) -> Reason:
        """All values decide together: a few are shown, and the window that all of them need."""
        text = "for every value" if holds else "for no value"
        bodies = self._recall.bindings(part) if self._recall.first == 1 else None
        if not bodies or any(self._recall.at(body, s) is not holds for body in bodies for s in steps):
            return self._reason(part, steps, holds, text)
        found = [(body, self.reasons(body, holds, steps)) for body in bodies]
        told = [spot for _, reasons in found for spot in spots(reasons)]
        window = (min(spot[0] for spot in told), max(spot[1] for spot in told)) if told else None
        telling = [item for item in found if any(reason.holds for reason in leaves(item[1]))][:_MOST_TOLD]
        parts = []
        for body, reasons in telling:
            given = f"for {self._wording.values(body.scope, body.values)}"
            parts.append(self._reason(body, steps, holds, given, parts=tuple(reasons)))
        return self._reason(part, steps, holds, text, window=window, parts=tuple(parts))
