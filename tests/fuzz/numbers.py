"""What one monitor has sent under which number, and which of that must be in the history."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

from tests.fuzz.frames import Event


@dataclass
class Numbers:
    """All numbers of one monitor in one session, over its connections and instances."""

    sent: defaultdict[int, list[Event]] = field(default_factory=lambda: defaultdict(list))
    acked: int = 0
    refused: set[int] = field(default_factory=set)
    _jumped: list[tuple[int, int]] = field(default_factory=list)
    _high: int = 0

    @property
    def high(self) -> int:
        """The highest number that this connection has used up, at its begin the one before `next`."""
        return self._high

    def begin(self, upcoming: int) -> None:
        """Begin a connection that goes on with the number `upcoming`."""
        self._high = upcoming - 1

    def add(self, event: Event) -> None:
        """Note an event that is sent now."""
        if event.seq > self._high + 1:
            self._jumped.append((self._high + 1, event.seq - 1))
        self._high = max(self._high, event.seq)
        self.sent[event.seq].append(event)

    def must_be_judged(self) -> set[int]:
        """The numbers that were acked, and stand for an event that nothing was wrong with.

        Those that were jumped over on some connection are left out: they count as lost, if they came too late.
        """
        return {
            seq
            for seq, events in self.sent.items()
            if seq <= self.acked
            and all(event.sound for event in events)
            and not any(first <= seq <= last for first, last in self._jumped)
        }
