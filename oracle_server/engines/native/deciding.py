"""What explanations of all parts share: when a part held, which windows decide, and how a reason is made."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

from oracle_server.core.explanation import Failing, Reason
from oracle_server.core.formula.tree import Bound
from oracle_server.engines.native.build import Network
from oracle_server.engines.native.parts import Part, is_simple
from oracle_server.engines.native.recall import Recall
from oracle_server.engines.native.saying import Saying
from oracle_server.engines.native.wording import Wording

Steps = Sequence[int]
"""Numbers of remembered steps, ascending."""


class Deciding(ABC):
    """Makes the reasons of parts; what an operator's reasons are is its subclasses'."""

    def __init__(self, network: Network, recall: Recall, wording: Wording) -> None:
        self._network, self._recall, self._wording = network, recall, wording
        self._saying = Saying(recall, wording)
        self._now = recall.last

    @abstractmethod
    def reasons(self, part: Part, holds: bool, steps: Steps) -> list[Reason]:
        """What decides that a part holds at all of some steps, or at none of them."""

    def holds(self, part: Part) -> bool:
        """Whether a part holds now."""
        return self._recall.at(part, self._now) is True

    def _windows(self, bound: Bound, steps: Steps) -> tuple[list[int], bool]:
        """All steps in the windows of some steps, and whether all of them are remembered."""
        windows = [self._recall.window(bound, step) for step in steps]
        return sorted({j for window, _ in windows for j in window}), all(complete for _, complete in windows)

    def _where(self, bound: Bound, steps: Steps, window: Steps, *, whole: bool) -> tuple[str, tuple[int, int] | None]:
        """Windows in words, and the first and the last time in them.

        `window` are the remembered steps in them; `whole`: those are all that there were.
        """
        if [*steps] == [self._now]:
            first, last = self._wording.ends(bound)
            return self._wording.window(bound), (first, last) if first <= last else None
        spans = _merged([self._wording.ends(bound, time) for time in self._times(steps)])
        if not self._wording.is_timed and spans:
            return self._wording.among(spans), (spans[0][0], spans[-1][1])
        if not spans or (self._recall.first == 1 and spans[-1][1] < self._recall.time(1)):
            return "before there were steps", None
        return self._where_in_time(bound, steps, window, spans, whole=whole)

    def _where_in_time(
        self, bound: Bound, steps: Steps, window: Steps, spans: Sequence[tuple[int, int]], *, whole: bool
    ) -> tuple[str, tuple[int, int]]:
        """The same with `time: seconds`; between `spans` there may be steps that are in no window."""
        known = whole and len(window) > 0
        first, last = self._times([window[0], window[-1]]) if known else (spans[0][0], spans[-1][1])
        text = self._wording.during(first, last)
        if bound.upper is None and not whole:
            text = "so far" if last == self._recall.time(self._now) else f"{self._wording.ago(last)} or earlier"
        if self._recall.within(first, last) != len(window) or (len(spans) > 1 and not whole):
            text = f"in {'its window' if len(steps) == 1 else 'their windows'}, {text}"
        return text, (first, last)

    def _deeper(self, sides: list[tuple[Part, bool, Steps]]) -> tuple[Reason, ...]:
        """The reasons for operands, where they are more than whether an atom held."""
        if all(is_simple(operand.formula) for operand, _, _ in sides):
            return ()
        return tuple(reason for side in sides if side[2] for reason in self.reasons(*side))

    def _times(self, steps: Steps) -> list[int]:
        return [self._recall.time(step) for step in steps]

    def _plain(self, part: Part, steps: Steps, holds: bool) -> Reason:
        """The reason that a part held, or did not, without parts of its own."""
        times = self._times(steps)
        now = [*steps] == [self._now]
        text, failed = self._saying.stood(part, times, steps, holds=holds)
        return self._reason(part, [self._now], holds, text, [] if now and not holds else times, steps, failed=failed)

    def _reason(
        self,
        part: Part,
        steps: Steps,
        holds: bool,
        text: str,
        times: Sequence[int] = (),
        found: Steps = (),
        *,
        window: tuple[int, int] | None = None,
        parts: tuple[Reason, ...] = (),
        failed: tuple[Failing, ...] = (),
        told: bool = False,
    ) -> Reason:
        """A reason at `steps`, which steps `found` at `times` decide, or a window."""
        if [*steps] != [self._now]:
            text = f"({self._wording.at(self._times(steps), steps)}) {text}"
        if len(times) > 1:
            window = times[0], times[-1] if window is None else window[1]
        at = times[0] if len(times) == 1 else None
        step = found[0] if at is not None and found else None
        unnumbered = at is not None and self._wording.is_unnumbered(at)
        window = None if window is None else self._wording.numbered(*window)
        return Reason(self._wording.formula(part), holds, text, at, window, parts, step, failed, unnumbered, told)


def _merged(spans: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Spans in ascending order, without empty ones; those that leave nothing between them are one."""
    merged: list[tuple[int, int]] = []
    for first, last in spans:
        if merged and first <= merged[-1][1] + 1:
            merged[-1] = merged[-1][0], max(last, merged[-1][1])
        elif first <= last:
            merged.append((first, last))
    return merged
