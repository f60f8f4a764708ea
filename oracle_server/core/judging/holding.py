"""Held signals: the last values that later events of the same monitor have too."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from oracle_server.core.events import Step
from oracle_server.core.formula.tree import Scalar


@dataclass(slots=True)
class Held:
    """The last values of one monitor's held signals; `failed` are those whose last value is not known."""

    values: dict[str, Scalar] = field(default_factory=dict)
    failed: set[str] = field(default_factory=set)
    rank: int = 0
    """The larger, the later its last event was."""

    def copy(self) -> Held:
        """The same values, which change by themselves."""
        return Held(dict(self.values), set(self.failed))

    def take(self, names: frozenset[str], step: Step) -> None:
        """Hold these signals of a step; one that the step lacks is held no more."""
        self.failed = (self.failed - names) | (names & step.failed)
        for name in names:
            self.values.pop(name, None)
            if name in step.signals:
                self.values[name] = step.signals[name]


class Version:
    """How all that is held stood once: in place of that, what was otherwise of one monitor than in the `newer` one."""

    __slots__ = ("before", "monitor", "newer")

    def __init__(self) -> None:
        self.newer: Version | None = None
        """None for how it stands now."""
        self.monitor = ""
        self.before: Held | None = None


class Holding:
    """What each monitor's streams hold, and how that stood; a version costs the same for any number of monitors."""

    def __init__(self, known: Iterable[tuple[str, Held]] = ()) -> None:
        """Begin with what some monitors hold, the one last whose event was the latest."""
        self._of: dict[str, Held] = {}
        self.version = Version()
        """How it stands now; for `go_to`."""
        self._latest = 0
        self._together: tuple[dict[str, Scalar], set[str]] | None = {}, set()
        """Of all, with values of signals that failed later; None where it is to be made anew."""
        for monitor, held in known:
            self._set(monitor, self._ranked(held))
        self._together = None

    def __bool__(self) -> bool:
        return bool(self._of)

    def of(self, monitor: str) -> Held | None:
        """What a monitor's streams hold, not to be changed; None where it is nothing."""
        return self._of.get(monitor)

    def all(self) -> list[tuple[str, Held]]:
        """What each monitor's streams hold, that last whose event was the latest."""
        return sorted(self._of.items(), key=lambda item: item[1].rank)

    def take(self, monitor: str, names: frozenset[str], step: Step) -> None:
        """Hold these signals of a monitor's step, which is the latest one."""
        before = self._of.get(monitor)
        held = self._ranked(before.copy() if before is not None else Held())
        held.take(names, step)
        older = self.version
        older.newer = self.version = Version()
        older.monitor, older.before = monitor, before
        self._of[monitor] = held
        dropped = before is not None and not (before.values.keys() | before.failed) <= held.values.keys() | held.failed
        if self._together is not None:
            self._together = None if dropped else _with(*self._together, held)

    def go_to(self, version: Version) -> None:
        """Stand as it did then."""
        way = []
        while version.newer is not None:
            way.append(version)
            version = version.newer
        assert version is self.version  # noqa: S101 -- all lead to how it stands now
        for older in reversed(way):
            newer, monitor = self.version, older.monitor
            newer.newer, newer.monitor, newer.before = older, monitor, self._of.get(monitor)
            self._set(monitor, older.before)
            older.newer, older.before = None, None
            self.version = older
            self._together = None

    def together(self) -> tuple[dict[str, Scalar], set[str]]:
        """The values that all hold, and the signals that failed; of several that hold one, the last counts."""
        if self._together is None:
            self._together = {}, set()
            for _, held in self.all():
                self._together = _with(*self._together, held)
        values, failed = self._together
        return {name: value for name, value in values.items() if name not in failed}, set(failed)

    def _set(self, monitor: str, held: Held | None) -> None:
        if held is None:
            self._of.pop(monitor, None)
        else:
            self._of[monitor] = held

    def _ranked(self, held: Held) -> Held:
        self._latest += 1
        held.rank = self._latest
        return held


def _with(values: dict[str, Scalar], failed: set[str], held: Held) -> tuple[dict[str, Scalar], set[str]]:
    """What is held together with what the last one holds; the values are changed in place."""
    values |= held.values
    return values, (failed - held.values.keys()) | held.failed
