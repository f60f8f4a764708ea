"""Why an operator that looks back holds or does not: by the steps that decide it, and its operands at these."""

from __future__ import annotations

import itertools

from oracle_server.core.explanation import Reason
from oracle_server.core.formula import tree
from oracle_server.core.formula.tree import Bound
from oracle_server.engines.native.deciding import Deciding, Steps
from oracle_server.engines.native.ever import Ever
from oracle_server.engines.native.keys import key_of
from oracle_server.engines.native.latest import Latest
from oracle_server.engines.native.parts import Part, is_simple
from oracle_server.engines.native.preceded import Preceded
from oracle_server.engines.native.unbroken import Unbroken
from oracle_server.engines.native.window import Window

LooksBack = Ever | Latest | Window | Preceded | Unbroken


class LookingBack(Deciding):
    """Finds the reasons of `pre`, `once`, `historically` and `since`."""

    def _pre(self, part: Part, operand: Part, steps: Steps, holds: bool) -> Reason:
        before = [s - 1 for s in steps if s > 1]
        if not before:
            return self._reason(part, steps, holds, "there is no step before")
        known = before[0] >= self._recall.first
        if not known and [*steps] != [self._now]:
            return self._plain(part, steps, holds)
        times = self._times(before) if known else [self._network.timeline.before]
        parts = self._deeper([(operand, holds, before)]) if known else ()
        found = before if known else []
        held, failed = self._saying.held(operand, times, found, holds=holds)
        text = f"its operand {held}"
        return self._reason(part, steps, holds, text, times, found, parts=parts, failed=failed, told=True)

    def _once(self, part: Part, steps: Steps, holds: bool) -> Reason:
        formula = part.formula
        assert isinstance(formula, tree.Once | tree.Historically)  # noqa: S101 -- see `reasons`
        operand, wanted = part.child(formula.operand), isinstance(formula, tree.Once)
        if holds is not wanted:
            return self._nowhere(part, operand, steps, holds)
        times, found = self._witnesses(part, operand, steps, wanted=wanted)
        if not times:
            return self._unwitnessed(part, steps, holds)
        parts = self._deeper([(operand, wanted, found)])
        text, failed = self._saying.stood(operand, times, found, holds=wanted)
        text += self._saying.ran_out(formula.bound) if [*steps] == [self._now] else ""
        return self._reason(part, steps, holds, text, times, found, parts=parts, failed=failed)

    def _witnesses(self, part: Part, operand: Part, steps: Steps, *, wanted: bool) -> tuple[list[int], list[int]]:
        """The times of steps that make `once` hold at all of some steps, and these as far as they are remembered."""
        assert isinstance(part.formula, tree.Once | tree.Historically)  # noqa: S101 -- see `reasons`
        if [*steps] == [self._now]:
            return self._witness_now(part, operand, wanted=wanted)
        found: list[int] = []
        for step in steps:
            window, _ = self._recall.window(part.formula.bound, step)
            if found and found[-1] in window:
                continue
            witness = next((j for j in reversed(window) if self._recall.at(operand, j) is wanted), None)
            if witness is None:
                return [], []
            found.append(witness)
        return self._times(found), found

    def _witness_now(self, part: Part, operand: Part, *, wanted: bool) -> tuple[list[int], list[int]]:
        """The time of a step that makes `once` hold now, and the step if it is remembered; nothing if none is known."""
        when = self._when(part)
        if when is None:
            return [], []
        found = self._recall.steps(when)
        stood = [self._recall.at(operand, step) for step in found]
        if wanted in stood:
            step = found[stood.index(wanted)]
            return [when], [step]
        if self._is_its_own(part) and (not stood or None in stood):
            return [when], []
        window, _ = self._recall.window(_bound(part), self._now)
        looked = itertools.takewhile(lambda _: self._recall.spend(), reversed(window))
        other = next((j for j in looked if self._recall.at(operand, j) is wanted), None)
        return ([], []) if other is None else ([self._recall.time(other)], [other])

    def _unwitnessed(self, part: Part, steps: Steps, holds: bool) -> Reason:
        """That a part held at all of some steps, or at none of them, where no step that decides it is known."""
        if [*steps] != [self._now]:
            return self._plain(part, steps, holds)
        text = f"{'holds' if holds else 'does not hold'}; which step decides it is not known"
        return self._reason(part, steps, holds, text)

    def _is_its_own(self, part: Part) -> bool:
        """Whether the time that the engine goes by is surely of these values.

        Values that it does not tell apart any more share one, which may be that of one of them only.
        """
        node = self._network.places[part.path]
        shares = isinstance(node, Window) and _bound(part).upper is None
        return not shares or all(part.values.get(v) is None for v in node.variables)

    def _when(self, part: Part) -> int | None:
        """The time of a step that makes an operator hold now, as the engine knows it."""
        node = self._network.places[part.path]
        assert isinstance(node, LooksBack)  # noqa: S101 -- what these operators are built as
        return node.when(key_of([part.values.get(v) for v in node.variables]))

    def _nowhere(self, part: Part, operand: Part, steps: Steps, holds: bool) -> Reason:
        assert isinstance(part.formula, tree.Once | tree.Historically)  # noqa: S101 -- see `reasons`
        window, complete = self._windows(part.formula.bound, steps)
        where, ends = self._where(part.formula.bound, steps, window, whole=complete)
        words = "at every one" if holds else "none"
        parts: tuple[Reason, ...] = ()
        simple = is_simple(operand.formula)
        if not simple and complete and window and self._recall.are(operand, holds, window):
            parts = self._deeper([(operand, holds, window)])
        text = f"{words} {where}"
        if not holds and [*steps] == [self._now]:
            text += self._saying.nearest(operand, part.formula.bound, window)
        return self._reason(part, steps, holds, text, window=ends, parts=parts)

    def _since(self, part: Part, steps: Steps, holds: bool) -> Reason:
        formula = part.formula
        assert isinstance(formula, tree.Since)  # noqa: S101 -- see `reasons`
        left, right = part.child(formula.left), part.child(formula.right, 1)
        return self._since_held(part, left, right, steps) if holds else self._since_not(part, left, right, steps)

    def _since_held(self, part: Part, left: Part, right: Part, steps: Steps) -> Reason:
        assert isinstance(part.formula, tree.Since)  # noqa: S101 -- see `reasons`
        witnesses, between, before = set[int](), set[int](), 0
        for step in steps:
            witness = self._recall.since(left, right, part.formula.bound, step)
            if witness is None:
                break
            witnesses.add(witness)
            between.update(range(max(witness, before) + 1, step + 1))  # a later step has no earlier witness
            before = step
        else:
            found = sorted(witnesses)
            times = self._times(found)
            lasted = tree.lasted(part.formula) is not None
            sides: list[tuple[Part, bool, Steps]] = [(right, True, found), (left, True, sorted(between))]
            parts = self._deeper([(right, True, sorted(witnesses | between))] if lasted else sides)
            text = self._saying.since(left, right, times, found)
            text += self._saying.ran_out(part.formula.bound) if [*steps] == [self._now] else ""
            window = (times[0], self._recall.time(steps[-1])) if between else None
            return self._reason(part, steps, True, text, times, found, window=window, parts=parts, told=lasted)
        when = self._when(part) if [*steps] == [self._now] else None
        if when is None or not self._is_its_own(part):
            return self._unwitnessed(part, steps, True)
        text = self._saying.since(left, right, [when], ()) + self._saying.ran_out(part.formula.bound)
        return self._reason(part, steps, True, text, [when], window=(when, self._network.timeline.now))

    def _since_not(self, part: Part, left: Part, right: Part, steps: Steps) -> Reason:
        assert isinstance(part.formula, tree.Since)  # noqa: S101 -- see `reasons`
        window, whole = self._windows(part.formula.bound, steps)
        where, ends = self._where(part.formula.bound, steps, window, whole=whole)
        if whole and [*steps] == [self._now] and is_simple(right.formula) and self._recall.are(right, False, window):
            text = f"no {self._wording.name(right)} {where}"
            text += self._saying.nearest(right, part.formula.bound, window)
            return self._reason(part, steps, False, text, window=ends)
        known, missing = True, set[int]()
        broken = set[int]()
        for step in steps:
            candidates, complete = self._recall.window(part.formula.bound, step)
            if self._recall.are(right, False, candidates):
                missing.update(candidates)
                known = known and complete
                continue
            past = range(step, candidates.start - 1, -1)
            failed = next((j for j in past if self._recall.at(left, j) is False), None)
            known = known and failed is not None
            broken.update(() if failed is None else (failed,))
            missing.update(j for j in candidates if failed is None or j >= failed)
        known = known and self._recall.are(right, False, missing)
        plain = is_simple(right.formula) and not broken
        sides = [(right, False, sorted(missing)), (left, False, sorted(broken))] if known and not plain else []
        text = f"none with its left side ever since {where}"
        lasted = tree.lasted(part.formula) is not None
        if lasted:
            sides = [(right, False, sorted(missing | broken))] if sides else []
            text = "it has not lasted so long"
        parts = tuple(r for side, value, at in sides if at for r in self.reasons(side, value, at))
        return self._reason(part, steps, False, text, window=ends, parts=parts, told=lasted)


def _bound(part: Part) -> Bound:
    assert isinstance(part.formula, tree.Once | tree.Historically | tree.Since)  # noqa: S101 -- see `reasons`
    return part.formula.bound
