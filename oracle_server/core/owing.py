"""What an engine tells of the obligations of its formula: those that are open, and those that were not answered."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

from oracle_server.core.engine import Engine
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.lost import Lost
from oracle_server.core.records import AboutRecord, EventRecord

MOST_TOLD = 100
"""Obligations that a record tells of; of others it has the count."""


class Unanswered(NamedTuple):
    """An obligation that was decided false: the event that triggered it, and the values of its variables."""

    event: EventRecord
    values: Mapping[str, Scalar]


@dataclass(frozen=True, slots=True)
class AllUnanswered:
    """How many obligations were decided false together, and the oldest of them, `MOST_TOLD` at most."""

    told: Sequence[Unanswered]
    count: int
    at_once: int = 0
    """How many of these the present step itself asked for."""

    @property
    def earlier(self) -> AllUnanswered:
        """Those that earlier steps asked for; what the present step asked for is the newest."""
        count = self.count - self.at_once
        return AllUnanswered(self.told[:count], count)

    def __bool__(self) -> bool:
        """Whether there are any."""
        return self.count > 0


NO_UNANSWERED = AllUnanswered((), 0)


class Owed(Protocol):
    """The obligations of one formula in one session."""

    event: Callable[[], EventRecord]
    """Tells the event of the present step; it is kept as long as what it triggered is open."""
    pending: int
    """How many are open."""
    lost: int
    """How many can't be decided any more, as of the last step or the time that came last."""
    closed: int
    """How many were decided with the last step, or by the time that came last."""

    def unanswered(self) -> AllUnanswered:
        """Those of them that were decided false."""
        ...


@runtime_checkable
class Owing(Engine, Protocol):
    """An engine whose formula may wait for what comes."""

    owed: Owed | None
    """None where its formula only looks back."""

    def lose(self, lost: Collection[Lost]) -> None:
        """For the next step alone: these atoms can't be judged."""
        ...

    def decide(self, time: int, enough: Callable[[], bool]) -> bool:
        """Before `pass_time`: decide a part of what that would, until `enough`; whether nothing of it is left.

        No step may come, and nothing be saved, before `pass_time` was called with this time (ns).
        """
        ...

    def pass_time(self, time: int) -> None:
        """Time (ns) has come without a step: what it decides is decided for good."""
        ...

    def end(self) -> None:
        """Nothing will come any more: all that is open is decided."""
        ...


@runtime_checkable
class Guarding(Owing, Protocol):
    """Such an engine of a property that guards streams."""

    breaks: bool
    """Whether the last step broke what is asked by `always`, also where that was decided false before, and counted."""


def about(unanswered: Sequence[Unanswered]) -> list[AboutRecord]:
    """What a record tells of obligations that were not answered."""
    return [{**each.event, "values": dict(each.values)} for each in unanswered]
