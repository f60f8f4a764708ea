"""Streams of which one monitor told what is held, and another what formulas ask of beside it: they never meet."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

from oracle_server.core.events import Event, StreamKey
from oracle_server.core.hazards.apart import unseen
from oracle_server.core.spec import Spec


class Apart:
    """Looks for signals that are held for one monitor, and read at events that come of others alone."""

    def __init__(self, spec: Spec) -> None:
        """Begin with nothing seen."""
        self._spec = spec
        self._monitors: defaultdict[StreamKey, set[str]] = defaultdict(set)

    def look(self, event: Event) -> None:
        """Look at an event that was judged."""
        self._monitors[event.stream].add(event.monitor)

    def doubts(self) -> Iterator[str]:
        """What is to be said of each signal that is held, a line each."""
        said = set[str]()
        for found in unseen(self._spec, self._monitors):
            if found.name not in said:
                said.add(found.name)
                mine, at, theirs = found.told(self._monitors)
                yield (
                    f"{found.holder}: {found.name} is held for {mine} alone, so that {found.property} did not see it "
                    f"at {at} of {theirs}: what is held is of each monitor by itself; `{{last: {found.name}}}` under "
                    "`derive` is of all"
                )
