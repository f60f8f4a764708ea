"""A spec as the rest of the core works from it: frozen, resolved, in nanoseconds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

from oracle_server.core.derived.definition import Definition
from oracle_server.core.events import By, Order, StreamKey
from oracle_server.core.expression import Expression, parse_expression
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.tree import Atom, Formula, atoms
from oracle_server.core.kinds import KINDS, Kind, Traits
from oracle_server.core.stamps import Stamp

IDENTIFIER = r"^[A-Za-z0-9_.-]{1,64}$"
"""What specs, properties, sessions and tokens may be called."""
UNREACHABLE = (".", "..")
"""What no new spec or session may be called: clients leave these out of paths."""
SECOND = 10**9
HORIZON = 2 * SECOND
GAP = SECOND
LONGEST_HORIZON = 3600 * SECOND
SILENT = Atom(())
"""The formula of a property that an external oracle judges; nothing reads it."""


@dataclass(frozen=True, slots=True)
class Ordering:
    """How the events of a session's monitors are put in order; durations in nanoseconds.

    With `late: revise`, an event that is late by no more than `horizon` is put in its place.
    """

    by: By = "publication"
    max_delay: int | None = SECOND // 5
    late: Literal["judge", "skip", "revise"] = "judge"
    max_skew: int = SECOND
    capacity: int = 10_000
    horizon: int = HORIZON


@dataclass(frozen=True, slots=True)
class StreamSpec:
    """One topic, or the events of one kind of a service or an action; durations in nanoseconds.

    `stamp` is where the publication time stands in the message, None for the default places; `signals` maps
    a signal to its expression, None for the default signals; `each` is the expression of a list of which every element
    is a step of its own, None where a message is one. `intercept` is for topics; `proxy` is for services and
    actions, `denied_response` for services, `via` and `denied_result` for actions. The kinds of a service share all
    but `stamp`, `hold`, `signals` and `each`; those of an action not `ordered` and `action` either, and
    some may be missing.
    `first`: what a spec says of the interface as a whole is checked here, once; None where that goes by the kind.
    """

    name: str
    kind: Kind = "topic"
    type: str = ""
    stamp: Stamp | None = None
    latency: int = SECOND // 50
    ordered: bool = True
    causes: tuple[str, ...] = ()
    hold: frozenset[str] = frozenset()
    signals: Mapping[str, str] | None = None
    each: str | None = None
    action: Literal["log", "filter"] = "log"
    intercept: Literal["publisher", "subscriber"] = "publisher"
    proxy: str = ""
    denied_response: Mapping[str, Any] | None = None
    on_unavailable: Literal["deny", "pass"] = "deny"
    decide_within: int = 2 * SECOND
    on_deny: Literal["keep", "undo"] = "keep"
    on_deny_given: bool = False
    via: Literal["proxy", "introspection"] = "proxy"
    denied_result: Mapping[str, Any] | None = None
    first: bool | None = None

    @property
    def key(self) -> StreamKey:
        """The name and kind that events refer to this stream by."""
        return StreamKey(self.name, self.kind)

    @property
    def traits(self) -> Traits:
        """What holds for all streams of this kind."""
        return KINDS[self.kind]

    def read(self, text: str) -> Expression:
        """A signal's expression. Raises `ExpressionError`."""
        return parse_expression(text, each=None if self.each is None else parse_expression(self.each))

    def declares(self, name: str) -> bool:
        """Whether a name may be that of a signal of this stream: one that is declared, or any field."""
        return self.signals is None or name in self.signals

    @property
    def leads(self) -> bool:
        """Whether it is the first stream of its interface."""
        return self.traits.leads if self.first is None else self.first

    @property
    def proxied(self) -> bool:
        """Whether its events pass through a proxy in the adapter, which stamps them, so that its clocks are exact."""
        return self.traits.proxied and self.via == "proxy"

    @property
    def held_back(self) -> int:
        """How far an adapter's clock for it is behind (ns): 0 where the adapter stamps the messages itself."""
        return 0 if self.proxied and not self.stamp else self.latency


@dataclass(frozen=True, slots=True)
class External:
    """An external oracle, in place of a formula; `timeout` (ns) is how long an answer may take.

    `streams` names the streams that it receives, None for all; `bare`: it gets their names without the leading slash.
    """

    url: str
    timeout: int = SECOND
    streams: frozenset[str] | None = None
    bare: bool = False

    def receives(self, stream: StreamSpec) -> bool:
        """Whether the oracle is sent a stream's events."""
        return self.streams is None or stream.name in self.streams


@dataclass(frozen=True, slots=True)
class Property:
    """A named formula; `text` is what its author wrote, under the key that `says` it.

    An `external` one has `SILENT` there, and a `numeric` one, whose formula is over numbers, stands for its signals.
    """

    id: str
    formula: Formula
    text: str = ""
    description: str = ""
    time: Time = "steps"
    time_given: bool = False
    guards: frozenset[str] = frozenset()
    blame: Literal["any", "caused"] = "any"
    blame_given: bool = False
    latch: bool = False
    at_end: Literal["ignore", "violated"] = "ignore"
    engine: str = "auto"
    numeric: bool = False
    external: External | None = None
    says: Literal["formula", "pattern", "requirement", "machine"] = "formula"
    measures: tuple[Definition, ...] = ()
    """The derived signals that a pattern makes for itself."""
    states: tuple[Formula, ...] = ()
    """What the scope and the condition of a sentence take to last from one step to the next."""

    @property
    def atoms(self) -> tuple[Atom, ...]:
        """The different atoms of the formula."""
        return () if self.external else atoms(self.formula)


@dataclass(frozen=True)
class Retention:
    """How much history is kept: for so long (ns), so many events, so many bytes; None for any."""

    age: int | None = None
    events: int | None = None
    size: int | None = None


@dataclass(frozen=True)
class Spec:
    """Streams to observe and properties that judge them; `digest` is equal for specs of equal meaning."""

    id: str
    streams: tuple[StreamSpec, ...]
    properties: tuple[Property, ...]
    ordering: Ordering = field(default_factory=Ordering)
    description: str = ""
    digest: str = ""
    retention: Retention = Retention()
    close_after: int | None = None
    """For how long (ns) an open session may be without a monitor before it is closed; None for any time."""
    derive: tuple[Definition, ...] = ()
    gap: int = GAP
    """Violations of a property less than so long (ns) after the last one are one episode."""

    @cached_property
    def by_key(self) -> Mapping[StreamKey, StreamSpec]:
        """The streams by name and kind."""
        return {stream.key: stream for stream in self.streams}

    @cached_property
    def kept(self) -> frozenset[str]:
        """The signals that a step may have whatever its stream is: those that are held, and those that are derived."""
        derived = frozenset(definition.name for definition in self.derive)
        return derived.union(*(stream.hold for stream in self.streams))

    @cached_property
    def filtered(self) -> Mapping[str, int]:
        """The topics, services and actions of which something is decided: the places of their first such streams."""
        decided = [(s.name, i) for i, s in enumerate(self.streams) if s.action == "filter"]
        return dict(reversed(decided))

    def derived_of(self, prop: Property) -> tuple[str, ...]:
        """The derived signals that a property reads, in their order."""
        keys = {c.key for atom in prop.atoms for c in atom.constraints}
        return tuple(definition.name for definition in self.derive if definition.name in keys)

    @cached_property
    def readings(self) -> tuple[tuple[Atom, ...], ...]:
        """The atoms of each property, and behind them what each derived signal reads."""
        return (*(prop.atoms for prop in self.properties), *(definition.atoms for definition in self.derive))

    @cached_property
    def names(self) -> frozenset[str]:
        """The names of all topics and services."""
        return frozenset(stream.name for stream in self.streams)


def orders(spec: Spec) -> tuple[Order, ...]:
    """The orders that a session of a spec judges in; the first one decides."""
    by = spec.ordering.by
    return ("publication", "arrival") if by == "both" else (by,)
