"""The socket that the server listens on: it counts connections from the accept to the close of their descriptors."""

from __future__ import annotations

import contextlib
import errno
import os
import socket
from typing import Any

from oracle_server.edge.visitors import Visitor, Visitors

_AT_ONCE = 16
"""Connections that are accepted before the event loop has its turn; each may begin a TLS handshake."""
_UNIX = "unix"
"""The address of all that come by a UNIX socket."""


class Listener(socket.socket):
    """A listening socket that asks `visitors` about each connection."""

    def __init__(self, visitors: Visitors, family: int, kind: int, protocol: int) -> None:
        super().__init__(family, kind, protocol)
        self._visitors = visitors
        self._run = 0
        self._spare: int | None = _descriptor()

    def accept(self) -> tuple[socket.socket, Any]:
        """Accept a connection. Raises `BlockingIOError` where none waits, or the event loop should have its turn."""
        if self._run >= _AT_ONCE:
            self._run = 0
            raise BlockingIOError
        try:
            accepted, address = super().accept()
        except BlockingIOError:
            self._run = 0
            raise
        except OSError as error:
            self._run = _AT_ONCE  # asyncio would ask again at once, and log each time
            if error.errno != errno.EMFILE:
                raise
            self._refuse_one()
            raise BlockingIOError from None
        self._run += 1
        made = _Accepted(accepted)
        who = str(address[0]) if address else _UNIX
        made.visitor = self._visitors.admit(made.fileno(), who, made.cut)
        if made.visitor is None:
            made.close()
            raise BlockingIOError
        return made, address

    def close(self) -> None:
        """Close the socket, and give back the spare descriptor."""
        super().close()
        if self._spare is not None:
            os.close(self._spare)
            self._spare = None

    def _refuse_one(self) -> None:
        """Accept a connection with the spare descriptor and close it, since it would be reported again for ever."""
        self._visitors.tell("connections were refused: no more files can be opened", "")
        if self._spare is not None:
            os.close(self._spare)
        with contextlib.suppress(OSError):
            accepted, _ = super().accept()
            accepted.close()
        self._spare = _descriptor()


class _Accepted(socket.socket):
    """A connection that gives its place back when its descriptor is closed."""

    def __init__(self, accepted: socket.socket) -> None:
        super().__init__(accepted.family, accepted.type, accepted.proto, accepted.detach())
        self.visitor: Visitor | None = None

    def cut(self) -> None:
        """End the connection in both directions; who reads from it closes it then."""
        with contextlib.suppress(OSError):
            self.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        super().close()
        if self.visitor is not None:
            self.visitor.left()
            self.visitor = None


def _descriptor() -> int | None:
    try:
        return os.open(os.devnull, os.O_RDONLY)
    except OSError:
        return None
