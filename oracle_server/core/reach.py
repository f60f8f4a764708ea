"""Which atoms concern which streams: an atom that demands an interface's name need not be looked at for all others.

What the atoms say that name no interface is the same for all streams of one kind with the same signals.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator, Sequence

from oracle_server.core.formula.tree import Atom
from oracle_server.core.spec import StreamSpec

Indexed = tuple[int, Atom]
"""An atom, and its place among those of its formula."""


class Reach:
    """The atoms of a spec's formulas, by the names of interfaces in them."""

    def __init__(self, formulas: Sequence[Sequence[Atom]], naming: Collection[str]) -> None:
        """Divide the atoms of formulas, each of which has every atom once, by the keys that name interfaces."""
        self.free: list[list[Indexed]] = []
        """For each formula the atoms that say nothing of names."""
        self._tied: defaultdict[tuple[str, str], list[tuple[int, Indexed]]] = defaultdict(list)
        self._odd: list[tuple[int, Indexed]] = []
        for i, atoms in enumerate(formulas):
            self.free.append([])
            for indexed in enumerate(atoms):
                said = [c for c in indexed[1].constraints if c.key in naming]
                demanded = next(((c.key, c.value) for c in said if c.op == "==" and isinstance(c.value, str)), None)
                if demanded is not None:
                    self._tied[demanded].append((i, indexed))
                elif said:
                    self._odd.append((i, indexed))
                else:
                    self.free[i].append(indexed)

    def naming(self, stream: StreamSpec) -> Iterator[tuple[int, Indexed]]:
        """The other atoms that may hold on a stream, each with the index of its formula."""
        yield from self._tied.get((stream.traits.group, stream.name), ())
        yield from self._odd
