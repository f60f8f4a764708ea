"""How far the streams of a monitor have come: what is sent as their clocks."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Callable, Iterable, List, Optional, Sequence

if TYPE_CHECKING:
    from typing import Protocol

    from oracle_adapter.marks import ClockStamp

    class ClockedStream(Protocol):
        """One stream that an adapter observes."""

        name: str
        kind: str

        @property
        def latency(self) -> Optional[int]:
            """How late its events may be (ns); None: stamped here, under the link's lock."""


SIMULATED = "simulated time"
"""What the board calls the clock, which may be a stream too."""
CLOCK_WITHIN = 5.0
"""Seconds for /clock to be discovered, before it is said that it does not come."""


class SilentClock:
    """Whether simulated time stands: nothing gets old then, and no deadline runs out."""

    def __init__(
        self, now: Callable[[], Optional[int]], clock: Callable[[], float] = time.monotonic
    ) -> None:
        """`now` is simulated time (ns); nothing, or 0, while there is none. `clock`: seconds."""
        self._now, self._clock = now, clock
        self._last, self._since = now() or 0, clock()
        self.doubt = ""
        """That a time other than 0 stands, as of the last look: there may be a pause."""

    def look(self) -> str:
        """What is wrong, empty for nothing: that time stands at 0. What may be is in `doubt`."""
        last = self._now() or 0
        if last != self._last:
            self._last, self._since = last, self._clock()
        stands = self._clock() - self._since >= CLOCK_WITHIN
        at = f"{last // 10**9}.{last // 10**6 % 1000:03} s" if last else "0"
        text = f"time stands at {at}, so no deadline runs out: /clock is silent, or paused"
        self.doubt = text if stands and last else ""
        return text if stands and not last else ""


def wall_doubt(tellers: Iterable[str], instead: str) -> str:
    """What may be wrong where a node runs by the wall clock, and these publish `/clock`.

    Empty for nothing. `instead`: what to do where the robot runs by that time.
    """
    nodes = ", ".join(sorted(set(tellers)))
    if not nodes:
        return ""
    told = f"/clock is published by {nodes}, and the adapter runs by the wall clock"
    return f"{told}: where the robot runs by /clock, {instead}"


class TornClock:
    """Whether simulated time has gone back while several nodes tell it.

    Each step back ends a session.
    """

    def __init__(self) -> None:
        self._went_back = False

    def goes_back(self) -> None:
        """Note that it does."""
        self._went_back = True

    def look(self, tellers: Sequence[str]) -> str:
        """What is wrong, empty for nothing; `tellers` are the nodes that publish it."""
        # else it was a reset, or a bag that is played again
        self._went_back = self._went_back and len(tellers) > 1
        if not self._went_back:
            return ""
        nodes = ", ".join(sorted(tellers))
        return f"time went back, which ends the session, and several publish /clock: {nodes}"


class Clocks:
    """Reads the clocks of all streams of a monitor; to be called under the link's lock."""

    def __init__(self, now: Callable[[], Optional[int]]) -> None:
        """`now` is the present time (ns); nothing, or 0, while there is none."""
        self._now = now
        self._streams: Sequence[ClockedStream] = ()

    def follow(self, streams: Iterable[ClockedStream]) -> None:
        """Speak for these streams, too."""
        self._streams = (*self._streams, *streams)

    def readings(self, received_by: Optional[int]) -> List[ClockStamp]:
        """The clock of each stream: the present where it is stamped here, else less its latency.

        What others have published is here as of `received_by` (ns); None where that is not known:
        then nothing is said of their streams.
        """
        found = self._stamped_here()
        if received_by:
            found += [
                (stream.name, stream.kind, max(0, received_by - stream.latency))
                for stream in self._streams
                if stream.latency is not None
            ]
        return found

    def gone_back(self) -> List[ClockStamp]:
        """The clock of each stream as time has gone back, also to 0, as where a world is reset."""
        now = self._now() or 0
        return [(s.name, s.kind, max(0, now - (s.latency or 0))) for s in self._streams]

    def behind(self, name: str, kind: str) -> Callable[[], List[ClockStamp]]:
        """What to send behind each ask of a stream: the clocks of all streams stamped here.

        Else the decision would wait for the monitor's next clocks. Where no other stream is
        stamped here there is nothing to send: the ask says as much.
        """

        def stamps() -> List[ClockStamp]:
            found = self._stamped_here()
            return found if any(stamp[:2] != (name, kind) for stamp in found) else []

        return stamps

    def _stamped_here(self) -> List[ClockStamp]:
        now = self._now()
        return [(s.name, s.kind, now) for s in self._streams if s.latency is None] if now else []
