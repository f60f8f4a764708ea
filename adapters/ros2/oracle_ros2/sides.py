"""Streams whose events are stamped here: requests and responses of services, and the like of actions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Callable

from oracle_adapter.fields import not_there
from oracle_adapter.interfaces import is_filtered
from oracle_adapter.passing import Passing

from oracle_ros2.codec import lacking, reader
from oracle_ros2.stamps import misplaced, stamp_reader, time_of

if TYPE_CHECKING:
    from oracle_adapter import Answer, TimeSource
    from oracle_adapter.interfaces import Stream
    from oracle_adapter.link import Details
    from oracle_adapter.passing import TakeBack

    from oracle_ros2.shared import Shared


When = Callable[[Callable[[], object]], object]


def now(call: Callable[[], object]) -> None:
    """Call it."""
    call()


class Side:
    """One such stream: it reports its events, and asks about them where they are filtered."""

    def __init__(self, shared: Shared, stream: Stream, message_type: Any) -> None:
        self._link, self._time = shared.link, time_of(shared.node)
        self.name, self.kind = str(stream["name"]), str(stream["kind"])
        self._passing: Passing | None = None
        if is_filtered(stream):
            self._passing = Passing(shared.link, shared.board, stream, shared.clocks)
        what = f"the {self.kind} of {stream['type']}"
        troubles = [not_there(what, lacking(message_type, stream.get("reads") or ()))]
        self._read = reader(message_type, stream["fields"], shared.frame)
        self._stamp = stream["stamp"] and stamp_reader(message_type, stream["stamp"])
        self.latency: int | None = stream["latency"] if self._stamp else None
        self.time_source: TimeSource = "field" if self._stamp else "arrival"
        if stream["stamp"] and not self._stamp:
            troubles.append(misplaced(what, stream["stamp"], self.time_source))
        self.trouble = "; ".join(filter(None, troubles))
        """Which fields the spec reads, or orders it by, that the type does not have here."""

    @property
    def asks(self) -> bool:
        """Whether its events pass only where the oracle allows them."""
        return self._passing is not None

    def judge(
        self, message: Any, give: Callable[[], bool], refuse: Callable[[], object], call: int | None = None,
        goal_id: str | None = None, status: str | None = None, when: When = now, lost: int = 0,
        before: Callable[[TakeBack], object] = lambda _: None,
    ) -> None:  # fmt: skip
        """Report an event, and call `give` where it passes, else `refuse`; after a decision in the link's thread.

        `give` returns whether it was passed on. `when` calls what settles the event, at once or later. `lost`: how many
        before it could not be read. `before` is given what takes an event back that was asked about, before it passes.
        """
        # stamped under the link's lock, so that no clock can exclude it before it is queued
        stamp = (self._stamp and self._stamp(message)) or self._time
        data = self._read(message)
        more: Details = {"call": call, "goal_id": goal_id, "status": status, "lost": lost}
        passing = self._passing
        if passing is None:
            self._link.send(self.name, self.kind, stamp, data, **more)
            when(give)
            return

        def settle(answer: Answer) -> None:
            before(lambda: passing.take_back(answer))
            passed, _reason = passing.settle(answer, lambda _: give(), None, call, goal_id or "")
            if not passed:
                refuse()

        passing.ask(stamp, data, lambda answer: when(lambda: settle(answer)), **more)
