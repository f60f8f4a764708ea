"""Where the server listens: at a port, and at a UNIX socket."""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import stat
from collections.abc import Iterator
from pathlib import Path

from oracle_server.core.errors import OracleError
from oracle_server.edge.listener import Listener
from oracle_server.edge.visitors import Visitors

_UNSENT = 2**14
"""Bytes that the operating system buffers for a client that does not read."""
_HINTS = {
    errno.EADDRINUSE: "; stop what uses it, or choose another --port",
    errno.EACCES: "; ports below 1024 are the system's: choose another --port",
}


class ListenError(OracleError):
    """An address that can't be listened at."""


def listen(host: str, port: int, visitors: Visitors) -> Listener:
    """Listen at a port. Raises `ListenError`."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # asyncio disables Nagle's algorithm only where the protocol is given; with it a decision can wait 40 ms
    listener = Listener(visitors, family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, _UNSENT)
    try:
        listener.bind((host, port))
    except OSError as error:
        listener.close()
        hint = _HINTS.get(error.errno or 0, "")
        raise ListenError(f"{bracketed(host)}:{port}: {error.strerror}{hint}") from None
    return listener


@contextlib.contextmanager
def listening_unix(path: Path | None, visitors: Visitors) -> Iterator[Listener | None]:
    """Listen at a UNIX socket, if there is to be one, that this user alone may use; it is gone afterwards.

    One that a server which was killed has left is replaced. Raises `ListenError`.
    """
    if path is None:
        yield None
        return
    listener = Listener(visitors, socket.AF_UNIX, socket.SOCK_STREAM, 0)
    try:
        _clear(path)
        _bind(listener, path)
        own = path.stat().st_ino
        try:
            yield listener
        finally:
            with contextlib.suppress(OSError):
                if path.stat().st_ino == own:  # else another server has replaced it
                    path.unlink()
    finally:
        listener.close()


def bracketed(host: str) -> str:
    """A host as URLs have it."""
    return f"[{host}]" if ":" in host else host


def _clear(path: Path) -> None:
    """Delete a socket that nobody listens at. Raises `ListenError` where somebody does, or it is no socket."""
    try:
        if not stat.S_ISSOCK(path.lstat().st_mode):
            raise ListenError(f"{path}: is there, and no socket; choose another --unix, or delete it")
        with socket.socket(socket.AF_UNIX) as client, contextlib.suppress(BlockingIOError):
            client.setblocking(False)  # where too many wait to be accepted, there is somebody, too
            client.connect(str(path))
    except FileNotFoundError:
        return
    except ConnectionRefusedError:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise ListenError(f"{path}: can't be used as a UNIX socket: {error.strerror or error}") from None
    else:
        raise ListenError(f"{path}: another process listens there; stop it, or choose another --unix")


def _bind(listener: Listener, path: Path) -> None:
    before = os.umask(0o177)
    try:
        listener.bind(str(path))
        listener.listen()
    except OSError as error:
        raise ListenError(f"{path}: can't be used as a UNIX socket: {error.strerror or error}") from None
    finally:
        os.umask(before)
