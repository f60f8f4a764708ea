"""The deadlines that a pass judges again: which row of before each of them has."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator

from oracle_server.core.derived.watch import Carried
from oracle_server.core.events import Signals, Step
from oracle_server.core.revise.kept import Kept

Identity = tuple[int, frozenset[Carried]]
"""What tells deadlines apart: their time (ns), and of one time the keys that they carry, or that are held."""


class OldTicks:
    """The rows of deadlines as they stood before a pass, until they are judged again."""

    def __init__(self, seen: Callable[[Signals], frozenset[Carried]]) -> None:
        """`seen` returns the keys among signals."""
        self._rows: defaultdict[int, list[Kept]] = defaultdict(list)
        self._seen = seen

    def __iter__(self) -> Iterator[Kept]:
        return (row for rows in self._rows.values() for row in rows)

    def add(self, row: Kept) -> None:
        """Add a row, which stood before the others."""
        self._rows[row.step.stamp].insert(0, row)

    def take(self, time: int, signals: Signals) -> Kept | None:
        """Take the row of a deadline with these signals, None where none was told before."""
        rows, seen = self._rows.get(time, []), self._seen
        found = next((row for row in rows if seen(row.step.signals) == seen(signals)), None)
        if found is not None:
            rows.remove(found)
        return found

    def clear(self) -> None:
        """Forget the others: they do not stand any more."""
        self._rows.clear()

    def identity(self, tick: Step) -> Identity:
        """What tells a deadline apart."""
        return tick.stamp, self._seen(tick.signals)
