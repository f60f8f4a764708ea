"""A set of positions, most of which follow each other: a bit for each."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Container, Iterable

_PAGE = 4096


class Positions(Container[int]):
    """Positions that were added; a million that follow each other take some 200 KB."""

    def __init__(self) -> None:
        """Begin with none."""
        self._pages: defaultdict[int, int] = defaultdict(int)

    def update(self, positions: Iterable[int]) -> None:
        """Add positions."""
        for position in positions:
            page, bit = divmod(position, _PAGE)
            self._pages[page] |= 1 << bit

    def __contains__(self, position: object) -> bool:
        """Whether it was added."""
        if not isinstance(position, int):
            return False
        page, bit = divmod(position, _PAGE)
        return bool(self._pages.get(page, 0) >> bit & 1)
