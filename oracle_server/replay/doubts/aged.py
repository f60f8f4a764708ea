"""Messages that stand long before all that was recorded with them, by their stamps: time alone decides much between."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping

from oracle_server.core.events import StreamKey
from oracle_server.core.naming import moment
from oracle_server.core.spec import SECOND
from oracle_server.core.verdicts import Judged
from oracle_server.replay.recording import Note, part_of

FAR = 60 * SECOND
"""No message that is on its way for so long is like the others: its clock was set, or is another one."""


class Aged:
    """Looks at events in the order of publication, and finds those behind which stamps leap and arrivals do not.

    What is as old and comes once something newer was judged is late, and told as that.
    """

    def __init__(self) -> None:
        """Begin with nothing judged."""
        self._count: Counter[StreamKey] = Counter()
        self._first: dict[StreamKey, tuple[int, int, int]] = {}
        self._last: Judged | None = None

    def look(self, judged: Judged) -> None:
        """Look at the next event that is not late."""
        last, self._last = self._last, judged
        if last is None:
            return
        before, after = last.step, judged.step
        apart = abs(after.event.arrived - before.event.arrived)
        if after.time - before.time - apart > FAR:
            stream = before.event.stream
            self._count[stream] += 1
            self._first.setdefault(stream, (before.time, after.time, apart))

    def notes(self, events: Mapping[StreamKey, int], told: Collection[StreamKey]) -> Iterator[Note]:
        """What is to be said of each stream, of which there are so many `events`, but for those that are `told` of."""
        for stream, (since, until, apart) in self._first.items():
            if stream in told:
                continue
            which = part_of(self._count[stream], events[stream])
            what = f"stamped {moment(since, until)}, {(until - since) / SECOND:.6g} s before what was judged next"
            yield Note(
                f"{stream}: {which} {what}, and arrived within {apart / SECOND:.3g} s of that: deadlines between these "
                "times ran out; where its stamps are not when it was published, name another field as `stamp`, or "
                "write `ordered: false`",
                doubt=True,
            )
