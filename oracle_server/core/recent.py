"""The last steps of a session, for explanations to point at."""

from __future__ import annotations

from collections import deque
from typing import Any

from oracle_server.core.events import Step, StreamKey

SIZE = 1024
"""Steps that are remembered; of older ones an explanation tells the number or the time alone."""


class Recent:
    """What is told of the last steps; all times in nanoseconds."""

    def __init__(self) -> None:
        self._steps: deque[tuple[int, int, StreamKey, int, str, int]] = deque(maxlen=SIZE)

    def add(self, number: int, time: int, step: Step) -> None:
        """Take in the next step."""
        event = step.event
        self._steps.append((number, time, event.stream, step.stamp, event.monitor, event.seq))

    def remove(self) -> None:
        """Forget the last step."""
        self._steps.pop()

    def snapshot(self) -> Any:
        """The steps as plain data."""
        return list(self._steps)

    def restore(self, data: Any) -> None:
        """Become what a snapshot says."""
        self._steps.extend((n, t, StreamKey(*stream), stamp, m, seq) for n, t, stream, stamp, m, seq in data)

    def at_step(self, number: int) -> dict[str, Any] | None:
        """The step of a number."""
        return next((_told(step) for step in reversed(self._steps) if step[0] == number), None)

    def at_time(self, time: int) -> dict[str, Any] | None:
        """The last step at a time."""
        return next((_told(step) for step in reversed(self._steps) if step[1] == time), None)


def _told(step: tuple[int, int, StreamKey, int, str, int]) -> dict[str, Any]:
    number, _, stream, stamp, monitor, seq = step
    return {"step": number, "stream": stream.name, "kind": stream.kind, "stamp": stamp, "monitor": monitor, "seq": seq}
