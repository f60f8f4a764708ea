"""Monitors that are the adapters' own link: what is resent, and when, is up to it."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from oracle_adapter import Link as AdapterLink
from oracle_adapter.connection import Timing
from oracle_adapter.decision import Answer

from tests.chaos.link import Frame
from tests.chaos.served import Served

_QUICK = Timing(open_timeout=3, attach_timeout=10, backoff_first=0.02, backoff_last=0.1)
_LOOK = 0.02
"""Seconds between looks at what is acked; a clock is told at each, as the adapters do it all the time."""
_CLOCK_EVERY = 40
"""Events from one clock to the next."""


@dataclass
class Robot:
    """One monitor with its whole life's `events`, numbered from 1; what it asks is answered in the link's thread."""

    served: Served
    attach: Frame
    events: list[Frame]
    end: int
    moved: Callable[[int], None]
    answered: Counter[int] = field(default_factory=Counter)
    """How often each ask was answered, by the event's number."""

    async def run(self) -> None:
        """Send all events, and return once they are acked; `moved` is called with what is newly acked."""
        link = AdapterLink(
            self.served.attach_url,
            self.attach["monitor"],
            spec=self.attach["spec"],
            session=self.attach["session"],
            streams=self.attach["streams"],
            timing=_QUICK,
        )
        with link:
            await asyncio.to_thread(link.wait_attached, 60)
            self._send_all(link)
            acked = 0
            while acked < len(self.events):
                await asyncio.sleep(_LOOK)  # the link tells nobody what is acked
                self._tell_time(link, self.end)
                found = link.stats().acked
                if found > acked:
                    self.moved(found - acked)
                    acked = found
            assert not link.stats().lost

    def _send_all(self, link: AdapterLink) -> None:
        for event in self.events:
            if event["seq"] % _CLOCK_EVERY == 0:
                self._tell_time(link, event["stamp"])
            more = {key: event[key] for key in ("source", "call") if key in event}
            what = (event["stream"], event["kind"], event["stamp"], event["data"])
            if event["ask"]:
                link.ask_then(*what, partial(self._handle, link, event["seq"]), decide_within=600, **more)
            else:
                link.send(*what, **more)

    def _handle(self, link: AdapterLink, seq: int, answer: Answer) -> None:
        self.answered[seq] += 1
        link.handled(answer, answer.decision == "allow", answer.why)

    def _tell_time(self, link: AdapterLink, stamp: int) -> None:
        attached = link.attached
        streams = () if attached is None else attached.streams
        link.clock([(stream["name"], stream["kind"], stamp) for stream in streams])
