"""Events, and their steps in an order. Times are integer nanoseconds since the epoch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple

import msgspec

from oracle_server.core.formula.tree import Scalar
from oracle_server.core.kinds import GOAL_ID, KINDS, REVISION, STATUS, TICK, Status, StepKind

Order = Literal["publication", "arrival"]
By = Literal[Order, "both"]
"""What a session is ordered by."""
TimeBase = Literal["wall", "sim"]
"""The time base of a monitor's clock: wall time, or the time of a simulation."""
Released = Literal["frontier", "clock", "max_delay", "capacity"]
"""Why the order of publication released an event: what all streams had shown or said, or what it waited for in vain."""
Signals = Mapping[str, Scalar]


class StreamKey(NamedTuple):
    """A stream of a spec: the events of one kind on one topic or service; or the stream of ticks, without a name."""

    name: str
    kind: StepKind

    def __str__(self) -> str:
        noun = KINDS[self.kind].noun
        return f"{self.name} {noun}" if noun else self.name


Source = tuple[str, StreamKey]
"""A monitor and a stream that it observes."""
TICKS = StreamKey("", TICK)
"""The stream of ticks, which no monitor observes."""
ENDED = "end"
"""The source of the tick at which a session has ended."""
REVISIONS = StreamKey("", REVISION)
"""The stream of revisions, which no monitor observes either."""


class Event(msgspec.Struct, frozen=True, gc=False):
    """One observed message, request or response, as its monitor reported it.

    `stamp` is the publication time, None where there is none; `seq` the monitor's own number; `call` is equal
    for a request and its response; `goal_id` and `status` are those of an action's events, which have them beside the
    message; `source` names the publisher; `lost` counts the messages lost just before it;
    `ask`: the monitor waits for a decision. `arrived` is in the session's own time; `received` is the
    server's where that differs, as in a simulation. `row` is which element of the message it stands for, from 0, None
    for the whole of it; `more`: further rows of the same event follow.
    """

    stream: StreamKey
    monitor: str
    seq: int
    stamp: int | None
    arrived: int
    data: object
    source: str = ""
    call: int | None = None
    lost: int = 0
    ask: bool = False
    received: int | None = None
    goal_id: str | None = None
    status: Status | None = None
    row: int | None = None
    more: bool = False

    @property
    def marks(self) -> dict[str, str]:
        """The signals that it has from its frame, which formulas see beside those of its message."""
        if self.goal_id is None:
            return {}
        return {GOAL_ID: self.goal_id} if self.status is None else {GOAL_ID: self.goal_id, STATUS: self.status}

    @property
    def came(self) -> int:
        """When it arrived at the server, in the server's time."""
        return self.arrived if self.received is None else self.received


Projected = tuple[Signals, frozenset[str]]
"""What formulas see of a message or of a row: its signals by name, and the names of those that failed."""


class Step(msgspec.Struct, frozen=True, gc=False):
    """An event with all that is needed to judge it: its signals and its place in the order.

    `failed` are the signals whose expressions failed; `stamp` is the publication time, or the arrival where
    there was none; `skewed` was stamped too far ahead of its arrival, and is ordered at its arrival instead;
    `late` is older than something already judged; `forced` was judged early because the order was full; `skipped`
    is not to be judged: it is late and the spec skips late events, or its verdicts could not be kept. `released` is why
    it left the order of publication, None where it was not in it; `unheard` are the streams of which nothing as new as
    it had come by then, where the spec revises and that is why it may be wrong. `waited` are the streams that it waited
    for last: whose advance, or end, released it, or that were still behind it when there was no more waiting. `rows`
    are what is judged instead of it, one after the other, where its stream has rows and its message some.
    """

    event: Event
    signals: Signals
    failed: frozenset[str]
    stamp: int
    skewed: bool = False
    late: bool = False
    forced: bool = False
    skipped: bool = False
    released: Released | None = None
    unheard: frozenset[str] = frozenset()
    waited: tuple[Source, ...] = ()
    rows: tuple[Projected, ...] = ()

    @property
    def time(self) -> int:
        """Where the event stands in the order of publication, in nanoseconds."""
        return self.event.arrived if self.skewed else self.stamp
