"""Streams of which one monitor told what is held, and another what formulas ask of beside it: they never meet."""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterator

from oracle_server.core.events import Event, StreamKey
from oracle_server.core.spec import Property, Spec, StreamSpec


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
        for holder in self._spec.streams:
            for name in sorted(holder.hold):
                yield from itertools.islice(self._unseen(holder, name), 1)

    def _unseen(self, holder: StreamSpec, name: str) -> Iterator[str]:
        """What is to be said of each property that reads what a stream holds."""
        mine = _listed(self._monitors[holder.key])
        for prop in self._spec.properties:
            others = [s for s in self._spec.streams if self._are_apart(holder, s) and _asks(prop, name, s)]
            if others:
                at = ", ".join(str(s.key) for s in others)
                theirs = _listed(set[str]().union(*(self._monitors[s.key] for s in others)))
                yield (
                    f"{holder.key}: {name} is held for {mine} alone, so that {prop.id} did not see it at {at} of "
                    f"{theirs}: what is held is of each monitor by itself; `{{last: {name}}}` under `derive` is of all"
                )

    def _are_apart(self, one: StreamSpec, other: StreamSpec) -> bool:
        """Whether both were told of, and never by the same monitor."""
        first, second = (self._monitors.get(s.key, set()) for s in (one, other))
        return bool(first and second) and first.isdisjoint(second)


def _asks(prop: Property, held: str, stream: StreamSpec) -> bool:
    """Whether a property reads what is held, and asks of a stream by its name, or by a signal of it."""
    keys = {c.key for atom in prop.atoms for c in atom.constraints}
    if held not in keys or held in (stream.signals or ()):
        return False
    named = {c.value for atom in prop.atoms for c in atom.constraints if c.key == stream.traits.group and c.op == "=="}
    return stream.name in named or not keys.isdisjoint(stream.signals or ())


def _listed(monitors: set[str]) -> str:
    return " and ".join(sorted(monitors))
