"""Small specs, sessions over them and events for them; times are small numbers of nanoseconds."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from oracle_server.core.atoms import Matches
from oracle_server.core.engine import Engine
from oracle_server.core.errors import EngineError
from oracle_server.core.events import Event, Order, StreamKey
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.ordering.simulated import ClockReading
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.spec import GAP, Ordering, Property, Spec, StreamSpec, orders
from oracle_server.core.verdicts import Judged, Outcome
from oracle_server.engines.reelay import ReelayEngine

A, B, U, MODE = (StreamKey(name, "topic") for name in ("/a", "/b", "/u", "/mode"))
REQUEST, RESPONSE = StreamKey("/s", "request"), StreamKey("/s", "response")
STREAMS = (
    StreamSpec("/a"),
    StreamSpec("/b"),
    StreamSpec("/u", ordered=False),
    StreamSpec("/mode", hold=frozenset({"mode"})),
    StreamSpec("/s", "request"),
    StreamSpec("/s", "response"),
)
MAX_DELAY = 50

Maker = Callable[[Property], Engine]


def prop(name: str, formula: str, **more: Any) -> Property:
    return Property(name, parse_formula(formula, more.get("time", "steps")), formula, **more)


def reelay(property_: Property) -> Engine:
    return ReelayEngine(property_.formula)


def open_session(
    properties: Sequence[Property],
    *,
    attach: Mapping[str, Iterable[StreamKey]],
    streams: Sequence[StreamSpec] = STREAMS,
    maker: Maker = reelay,
    begun: int | None = None,
    gap: int = GAP,
    **ordering: Any,
) -> Session:
    """A session with its monitors attached at time 0; whatever is said of the ordering goes over `max_delay` 50."""
    in_order = Ordering(**{"max_delay": MAX_DELAY, **ordering})
    spec = Spec("s", tuple(streams), tuple(properties), in_order, gap=gap)
    session = Session(plan(spec), [[maker(p) for p in properties] for _ in orders(spec)], begun=begun)
    for monitor, observed in attach.items():
        assert session.attach(monitor, observed, 0) == []
    return session


@dataclass
class Feed:
    """Tells a session what its monitors saw, each event under its monitor's next number."""

    session: Session
    seqs: dict[str, itertools.count[int]] = field(default_factory=dict)

    def __call__(
        self, stream: StreamKey, stamp: int | None, data: object = None, *, monitor: str = "m", **more: Any
    ) -> list[Judged]:
        """Ingest an event that arrived at its stamp, where nothing else is said."""
        seq = next(self.seqs.setdefault(monitor, itertools.count(1)))
        fields = {"arrived": stamp, "data": {} if data is None else data, **more}
        return self.session.ingest(Event(stream, monitor, seq, stamp, **fields))

    def clock(self, stream: StreamKey, stamp: int, now: int, monitor: str = "m") -> list[Judged]:
        return self.session.clock(monitor, [ClockReading(stream, stamp)], now)


def outcomes(judged: Iterable[Judged], name: str | None = None) -> list[str]:
    """The outcomes of one property, or of the only one there is."""
    return [v.outcome.value for j in judged for v in j.verdicts if name in (None, v.property)]


def degraded(judged: Iterable[Judged], name: str | None = None) -> list[bool]:
    return [v.degraded for j in judged for v in j.verdicts if name in (None, v.property)]


def stamps(judged: Iterable[Judged], order: Order = "publication") -> list[int]:
    """The stamps of what was judged in one order."""
    return [j.step.stamp for j in judged if j.order == order]


@dataclass
class Recorder:
    """An engine that says what it is told to, and remembers the times that it was stepped at."""

    says: Iterable[Outcome | Exception] = ()
    times: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._says = iter(self.says)

    def step(self, time: int, matches: Matches) -> Outcome:
        self.times.append(time)
        said = next(self._says, Outcome.CURRENTLY_TRUE)
        if isinstance(said, Exception):
            raise said
        return said


@dataclass
class Digest:
    """An engine whose outcome depends on all that it was ever told, and fails now and then for good."""

    told: int = 17

    def step(self, time: int, matches: Matches) -> Outcome:
        text = repr((self.told, time, tuple(matches)))
        self.told = sum(i * ord(c) for i, c in enumerate(text)) % 10_007
        if self.told % 97 == 0:
            raise EngineError("it had enough")
        return Outcome.CURRENTLY_TRUE if self.told % 3 else Outcome.CURRENTLY_FALSE
