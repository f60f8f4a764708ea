"""Who has connected, counted from the accept on: who has shown a token keeps their place, others make room.

Any number of silent connections keep nobody out: where there are too many, the oldest of those that have shown nothing
is closed, of the address that has most of them.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from ipaddress import IPv6Address, ip_address, ip_network

import structlog

from oracle_server.process.seldom import Seldom

REQUEST_WITHIN = 10.0
"""Seconds from the accept within which the head of a first request must arrive, the TLS handshake included."""
STRANGERS = 100
"""Connections beyond the limit for those that have not shown yet that they may stay."""
LEAVING = 100
"""Connections beyond these that are accepted while others, which were closed for them, have not ended yet."""
_SITE = 64
"""Bits of an IPv6 address that one site shares: it has all others to choose from."""

log = structlog.get_logger()


class Visitor:
    """One connection, from its accept to its end."""

    def __init__(self, visitors: Visitors, descriptor: int, address: str, end: Callable[[], None]) -> None:
        self.descriptor, self.address, self.end = descriptor, address, end
        """`end` closes the connection at once, whatever state it is in."""
        self.proven = False
        self._visitors = visitors
        self._timer: asyncio.TimerHandle | None = asyncio.get_running_loop().call_later(REQUEST_WITHIN, self._too_slow)

    def spoke(self) -> None:
        """Stop the time: the head of a request has arrived."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def prove(self) -> bool:
        """Keep the connection for a request that needs a token and is allowed; False where there are too many."""
        return self.proven or self._visitors.prove(self)

    def left(self) -> None:
        """Give the place back: the connection has ended."""
        self.spoke()
        self._visitors.remove(self)
        self.end = _nothing  # what it would end holds this visitor

    def _too_slow(self) -> None:
        self._timer = None
        self._visitors.tell("connections sent no request in time", self.address)
        self.end()


class Visitors:
    """All connections of a server, of which `most` may have shown that they may stay."""

    def __init__(self, most: int) -> None:
        self.most = most
        self.present: dict[int, Visitor] = {}
        """Those whose connection is open, by its file descriptor."""
        self._proven = 0
        self._strangers: dict[str, dict[Visitor, None]] = {}
        self._unproven = 0
        self._seldom = Seldom()

    def admit(self, descriptor: int, address: str, end: Callable[[], None]) -> Visitor | None:
        """A place for an accepted connection; None where it must be closed at once."""
        if len(self.present) >= self.most + STRANGERS + LEAVING:
            self.tell("connections were refused: there are too many", address)
            return None
        if self._proven + self._unproven >= self.most + STRANGERS:
            self._make_room()
        visitor = self.present[descriptor] = Visitor(self, descriptor, _site(address), end)
        self._strangers.setdefault(visitor.address, {})[visitor] = None
        self._unproven += 1
        return visitor

    def prove(self, visitor: Visitor) -> bool:
        """Keep a connection; False where `most` are kept already."""
        if self._proven >= self.most:
            self.tell("connections were refused: there are too many", visitor.address)
            return False
        self._forget(visitor)
        visitor.proven = True
        self._proven += 1
        return True

    def remove(self, visitor: Visitor) -> None:
        """Forget a connection that has ended; its descriptor is that of another one soon."""
        self._forget(visitor)
        self._proven -= visitor.proven
        visitor.proven = False
        self.present.pop(visitor.descriptor, None)

    def tell(self, what: str, address: str) -> None:
        """Log what happened to a connection, once a second at most."""
        count = self._seldom.due(what)
        if count:
            log.warning(what, count=count, last=address)

    def _make_room(self) -> None:
        """Close the oldest connection that has shown nothing, of the address that has most of them."""
        crowd = max(self._strangers.values(), key=len)
        oldest = next(iter(crowd))
        self._forget(oldest)
        self.tell("connections without a token were closed to make room", oldest.address)
        oldest.end()

    def _forget(self, visitor: Visitor) -> None:
        crowd = self._strangers.get(visitor.address)
        if crowd is not None and visitor in crowd:
            del crowd[visitor]
            self._unproven -= 1
            if not crowd:
                del self._strangers[visitor.address]


def _nothing() -> None:
    pass


def _site(address: str) -> str:
    """The address that is counted: for IPv6 the network, since a machine may use any address of it."""
    try:
        found = ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if not isinstance(found, IPv6Address):
        return address
    return str(found.ipv4_mapped or ip_network((int(found) >> _SITE << _SITE, _SITE)))
