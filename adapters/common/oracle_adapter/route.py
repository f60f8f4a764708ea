"""Which of several servers to connect to: one has the session, another one once that is gone."""

from __future__ import annotations

from typing import TYPE_CHECKING, Callable, Dict, Optional, Sequence, Set

from oracle_adapter.connection import attach_url

if TYPE_CHECKING:
    from oracle_adapter.connection import Address

_AVOIDED = 2.0
"""Seconds for which a server that could not be reached is not tried where others answer."""


class Route:
    """Addresses that are tried in turn, and the one that a server names, if it is one of them."""

    def __init__(self, addresses: Sequence[Address], clock: Callable[[], float]) -> None:
        """Begin with the first; `clock` tells seconds."""
        self._addresses, self._clock = addresses, clock
        self._at = 0
        self._tried: Set[int] = set()
        self._silent: Dict[int, float] = {}  # when those could not be reached that can't

    @property
    def address(self) -> Address:
        """Where to connect now."""
        return self._addresses[self._at]

    @property
    def several(self) -> bool:
        """Whether there is more than one."""
        return len(self._addresses) > 1

    def knows(self, url: str) -> bool:
        """Whether a server's address is one of these."""
        return self._index(url) is not None

    def lost(self) -> None:
        """A connection has ended that stood: the same server is the first to be tried."""
        self._tried.clear()

    def refused(self, url: Optional[str] = None) -> bool:
        """The server has answered, but does not have the session; `url` names the one that has.

        Returns whether there is another one to be tried at once.
        """
        self._silent.pop(self._at, None)
        return self._leave(None if url is None else self._index(url))

    def unreachable(self) -> bool:
        """The server has not answered; returns whether there is another one to be tried at once."""
        self._silent[self._at] = self._clock()
        return self._leave(None)

    def _leave(self, named: Optional[int]) -> bool:
        self._tried.add(self._at)
        count = len(self._addresses)
        others = [(self._at + step) % count for step in range(1, count + 1)]
        if named is not None:
            others.insert(0, named)
        good = [index for index in others if not self._is_avoided(index)]
        left = [index for index in good if index not in self._tried]
        self._at = (left or good or others)[0]
        if not left:
            self._tried.clear()
        return bool(left)

    def _is_avoided(self, index: int) -> bool:
        return self._clock() - self._silent.get(index, float("-inf")) < _AVOIDED

    def _index(self, url: str) -> Optional[int]:
        try:
            wanted = attach_url(url)
        except ValueError:
            return None
        urls = [address.url for address in self._addresses]
        return urls.index(wanted) if wanted in urls else None
