"""An episode as a value: violations of one property that follow each other closely; and how all of them stand."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Literal, TypedDict

import msgspec

from oracle_server.core.events import Order
from oracle_server.core.records import Number

_TENTH = math.log(1.1)


class Worst(msgspec.Struct, frozen=True, gc=False, omit_defaults=True):
    """The worst of an episode: its least `robustness`, or the `value` furthest from its bound.

    `signal` is what was compared by `op` with a `bound`, which is the value of the signal `than`, where there is one.
    Whole numbers stay such when they are read back.
    """

    robustness: Number = None
    signal: str | None = None
    op: str | None = None
    bound: int | float | None = None
    value: int | float | None = None
    than: str | None = None

    def graver(self, other: Worst | None) -> bool:
        """Whether it is to be kept instead of another, which it can be compared with."""
        if other is None:
            return True
        if self.robustness is not None:
            return other.robustness is None or float(self.robustness) < float(other.robustness)
        if self.signal != other.signal or self.op != other.op or self.than != other.than:
            return False
        return (self.than is not None or self.bound == other.bound) and self.distance > other.distance

    @property
    def distance(self) -> float:
        """How far the value is from its bound, or what is robust from being so."""
        return abs((self.value or 0) - (self.bound or 0)) if self.robustness is None else abs(float(self.robustness))

    @property
    def degree(self) -> int | None:
        """How bad it is, by steps of a tenth, by which it is told of while it grows: each row might be worse."""
        distance = self.distance
        return math.floor(math.log(distance) / _TENTH) if 0 < distance < math.inf else None


class Episode(msgspec.Struct, frozen=True, gc=False):
    """One episode of a property; times in nanoseconds.

    `first` and `last` are the numbers of the verdicts that violate first and last, `began` and `until` their times.
    `open`: it was not known to hold since; `final`: it never will. `count`: its violations, as a property counts them.
    """

    first: int
    began: int
    last: int
    until: int
    open: bool
    final: bool
    count: int
    worst: Worst | None = None


class EpisodeRecord(TypedDict):
    """An episode as it is told; times in nanoseconds. `last` and `until` are None while it is open.

    `first` and `last` are numbers of verdicts.
    """

    session: str
    spec: str
    property: str
    order: Order
    first: int
    began: int
    last: int | None
    until: int | None
    open: bool
    final: bool
    count: int
    worst: dict[str, Any] | None
    explanation: str | None


class Following(msgspec.Struct, frozen=True, gc=False):
    """How episodes stand after a row, at its `time` (ns): an entry a property, None where there is none that may go on.

    There are no entries where there is none at all.
    """

    time: int = 0
    episodes: tuple[Episode | None, ...] = ()

    @property
    def open(self) -> Iterator[tuple[int, Episode]]:
        """Those that are open, by the indexes of their properties."""
        return ((i, each) for i, each in enumerate(self.episodes) if each is not None and each.open)


class EpisodeChange(msgspec.Struct, frozen=True, gc=False):
    """What a row does with an episode of a property, by its `index`.

    It `begins` it, `joins` it, where that goes on, counts one more or grows worse, or `stops` it: the property holds;
    it may still go on. It `ends` where it can't any more, `goes` where what stands otherwise leaves nothing of it, and
    is `restated` where it is otherwise. `text` is the explanation of the violation that begins it, None where the row
    has that.

    `moved`: where it begins, that it was known as one that began elsewhere; where it goes, that it is known as such.
    """

    index: int
    kind: Literal["begins", "joins", "stops", "ends", "goes", "restated"]
    episode: Episode
    text: str | None = None
    moved: bool = False

    @property
    def is_kept(self) -> bool:
        """Whether anything is to be kept of it."""
        return self.kind != "ends"


Changes = tuple[EpisodeChange, ...]


def saved(following: Following) -> Any:
    """A `Following` as plain data."""
    return msgspec.to_builtins(following)


def loaded(data: Any) -> Following:
    """The same, back."""
    return msgspec.convert(data, Following) if data is not None else Following()
