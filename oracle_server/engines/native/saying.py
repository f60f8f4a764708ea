"""What is said of an operand at the steps that decide: when it held, by which values, and how nearly it did."""

from __future__ import annotations

from collections.abc import Sequence

from oracle_server.core.explanation import Failing
from oracle_server.core.formula import tree
from oracle_server.core.formula.tree import Atom, Bound
from oracle_server.core.kinds import NAMING
from oracle_server.engines.native.parts import Part, is_simple
from oracle_server.engines.native.recall import Recall
from oracle_server.engines.native.values import atom_of, failing, telling
from oracle_server.engines.native.wording import Wording, duration

Said = tuple[str, tuple[Failing, ...]]
"""A text, and the constraints of an atom that fail."""


class Saying:
    """Says how parts stood at steps; a step's values are told where it is a single one, and the part an atom."""

    def __init__(self, recall: Recall, wording: Wording) -> None:
        self._recall, self._wording = recall, wording

    def stood(self, part: Part, times: Sequence[int], steps: Sequence[int], *, holds: bool) -> Said:
        """That a part held at steps, or did not: an atom that failed is told by its values alone."""
        held, failed = self.held(part, times, steps, holds=holds)
        if not failed or not isinstance(part.formula, Atom):
            return held, failed
        return f"{_all(failed)}, {self._wording.at(times, steps)}", failed

    def held(self, part: Part, times: Sequence[int], steps: Sequence[int], *, holds: bool) -> Said:
        """The same, beginning with whether it held."""
        text = self._wording.held(times, steps, holds=holds)
        atom = atom_of(part)
        seen = self._recall.seen(steps[0]) if len(steps) == 1 else None
        if atom is None or seen is None:
            return text, ()
        failed = failing(part, atom, seen)
        if failed:
            return f"{text}: {_all(failed)}", failed
        values = telling(part, atom, seen)
        return (f"{text}, with {values}" if values else text), ()

    def ran_out(self, bound: Bound) -> str:
        """At a deadline, that the least distance of a bound has been reached."""
        late = self._wording.is_tick and bound.lower > 0
        return f"; its deadline of {duration(bound.lower)} ran out" if late else ""

    def since(self, left: Part, right: Part, times: Sequence[int], steps: Sequence[int]) -> str:
        """That the right side of a `since` held at steps, and the left one ever after."""
        text, _ = self.held(right, times, steps, holds=True)
        if left.formula == right.formula:
            return f"{self._wording.name(right) if is_simple(right.formula) else 'its operand'} {text}, and ever since"
        name = self._wording.name(right) if is_simple(right.formula) else "its right side"
        after = left.formula
        if isinstance(after, tree.Not) and is_simple(after):
            ever = f"no {self._wording.name(left.child(after.operand))} since"
        else:
            ever = f"{self._wording.name(left) if is_simple(after) else 'its left side'} ever since"
        return f"{name} {text}, and {ever}"

    def nearest(self, part: Part, bound: Bound, window: Sequence[int]) -> str:
        """Of a part that held nowhere in a window: when it last did before, and did after, or nearly did in it."""
        if not is_simple(part.formula):
            return ""
        before, after = self._before(part, bound), self._after(part, bound)
        if before.startswith(";") or after or not isinstance(part.formula, Atom):
            return before + after
        return before + self._near_miss(part, part.formula, window)

    def _before(self, part: Part, bound: Bound) -> str:
        """When it last held before the window."""
        first = None if bound.upper is None else self._recall.before(bound)
        step = None if first is None else self._recall.latest(part, first)
        if step is None or bound.upper is None:
            return ""
        if step == 0:
            return ", nor ever before" if first else ""
        return f"; last at {self._wording.step(step)}{self._aged(step, f'more than {duration(bound.upper)}')}"

    def _after(self, part: Part, bound: Bound) -> str:
        """When it first held after the window, too lately to be in it."""
        found = (j for j in self._recall.after(bound) if self._recall.spend() and self._recall.at(part, j) is True)
        step = next(found, None)
        if step is None or (step == self._recall.last and self._wording.is_tick):
            return ""
        if step == self._recall.last:
            return "; it holds at this step"
        return f"; next at {self._wording.step(step)}{self._aged(step, f'less than {duration(bound.lower)}')}"

    def _aged(self, step: int, than: str) -> str:
        """How long ago a step was, and that this is more, or less, than a bound has."""
        return f", {self._wording.ago(self._recall.time(step))}, {than}" if self._wording.is_timed else ""

    def _near_miss(self, part: Part, atom: Atom, window: Sequence[int]) -> str:
        """The last event in the window that met all constraints but one, which is none of the event itself."""
        for step in reversed(window):
            seen = self._recall.seen(step) if self._recall.spend() else None
            if seen is None:
                return ""
            failed = failing(part, atom, seen)
            if len(failed) == 1 and failed[0].signal not in NAMING and seen.number is not None:
                return f"; the last near miss: {failed[0].text}, at {self._wording.step(step)}"
        return ""


def _all(failed: tuple[Failing, ...]) -> str:
    return ", and ".join([each.text for each in failed])
