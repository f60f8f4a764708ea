"""What a recording holds, whatever its format: events, and what was said of them when they were recorded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Literal, NamedTuple, Protocol

from msgspec import Struct

from oracle_server.core.engine import Answer
from oracle_server.core.events import Event
from oracle_server.core.formula.tree import Scalar


class Projected(NamedTuple):
    """In place of a message: what formulas saw of it, and which signals failed."""

    signals: Mapping[str, Scalar]
    failed: frozenset[str]


class Place(Struct, frozen=True, gc=False):
    """Where a session judged an event in one of its orders, and when (ns).

    `position` counts what it judged, over both orders; `degraded`: something before was known to be lost; `said` is
    what oracles elsewhere said, by the properties that they judge.
    """

    position: int
    order: Literal["publication", "arrival"]
    judged: int
    late: bool = False
    skewed: bool = False
    forced: bool = False
    skipped: bool = False
    degraded: bool = False
    said: dict[str, Answer] = {}


class Recorded(Struct, frozen=True, gc=False):
    """A recorded event; a session's own trace also has its places, what its adapter did with it and why, and ticks.

    `verdict` is what ROSMonitoring's oracle said of it.
    """

    event: Event
    places: tuple[Place, ...] = ()
    passed: bool | None = None
    why: str | None = None
    verdict: str | None = None


class Recording(Protocol):
    """A recording for one spec, in the order of arrival; `read` of `size` is done."""

    path: Path
    clocked: bool
    ignored: Counter[str]
    read: int
    size: int

    def __iter__(self) -> Iterator[Recorded]:
        """The events of the spec's streams. Raises `TraceError`."""
        ...
