"""The last steps of a session, for explanations to point at."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from oracle_server.core.atoms import Matches
from oracle_server.core.events import Signals, Step, StreamKey
from oracle_server.core.past import Past
from oracle_server.core.plan import View
from oracle_server.core.records import EventRecord

SIZE = 1024
"""Steps that are remembered; of older ones an explanation has the number or the time only."""
EFFORT = 10_000
"""What one explanation may cost: some milliseconds."""

Seen = tuple[int, int, StreamKey, int, str, int, Signals]
"""A step's number and time, its event's stream, stamp, monitor and number there, and what formulas saw of it."""


class Recent:
    """The last steps; all times in nanoseconds."""

    def __init__(self, size: int = SIZE, effort: int = EFFORT) -> None:
        self._steps: deque[Seen] = deque(maxlen=size)
        self._effort = effort

    def add(self, number: int, time: int, step: Step, signals: Signals) -> None:
        """Add the next step, of which formulas see `signals`."""
        event = step.event
        self._steps.append((number, time, event.stream, step.stamp, event.monitor, event.seq, signals))

    def remove(self) -> None:
        """Forget the last step."""
        self._steps.pop()

    def snapshot(self) -> list[Any]:
        """The steps as plain data."""
        return list(self._steps)

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        self._steps.extend((n, t, StreamKey(*stream), *rest) for n, t, stream, *rest in data)

    def past(self, views: Callable[[StreamKey], View], *more: tuple[int, View, Signals]) -> Past:
        """These steps, and `more` after them, as a property observes them by its view of each stream."""
        steps = list(self._steps)
        times = [time for _, time, *_ in steps] + [time for time, _, _ in more]

        def matches(place: int) -> Matches:
            if place < len(steps):
                return views(steps[place][2]).matches(steps[place][6])
            _, view, signals = more[place - len(steps)]
            return view.matches(signals)

        return Past(times, matches, self._effort)

    def recall(self, at: int, step: int | None, *, timed: bool) -> EventRecord | None:
        """The event of a reason: of step number `step`, where that is known, else the only one at a time or number."""
        place, wanted = (1, at) if timed and step is None else (0, at if step is None else step)
        found = [seen for seen in self._steps if seen[place] == wanted]
        return _record(found[0]) if len(found) == 1 else None


def _record(seen: Seen) -> EventRecord:
    number, _, stream, stamp, monitor, seq, signals = seen
    return {
        "step": number,
        "stream": stream.name,
        "kind": stream.kind,
        "stamp": stamp,
        "monitor": monitor,
        "seq": seq,
        "signals": dict(signals),
    }
