"""Where an oracle is: the addresses of the host that a spec names, and no others, whatever an answer or a name says."""

from __future__ import annotations

import asyncio
import socket
from ipaddress import IPv4Address, IPv6Address, ip_address
from urllib.parse import urlsplit

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException

from oracle_server.core.errors import OracleError

_CLOSE_WITHIN = 1.0
_MAX_REPLY = 2**20


class UnreachableError(OracleError):
    """No connection can be made at present."""


class _Connect(connect):
    """A connection that follows no redirect: a spec says where its oracle is."""

    def process_redirect(self, exc: Exception) -> Exception:
        return exc


async def connected(url: str) -> ClientConnection:
    """A WebSocket to the oracle at an address of a spec. Raises `UnreachableError`, or what `websockets` does."""
    parts = urlsplit(url)
    port = parts.port or (443 if parts.scheme == "wss" else 80)
    failure: Exception = UnreachableError("its name has no address")
    for address in await _addresses(parts.hostname or "", port):
        try:
            return await _Connect(
                url, host=address, port=port, proxy=None, compression=None, open_timeout=None,
                close_timeout=_CLOSE_WITHIN, ping_interval=None, max_size=_MAX_REPLY,
            )  # fmt: skip
        except (OSError, WebSocketException) as error:
            failure = error
    raise failure


async def _addresses(host: str, port: int) -> list[str]:
    """The addresses of a host. Raises `UnreachableError` where a name stands for one that is no oracle's."""
    found = await asyncio.get_running_loop().getaddrinfo(host, port, type=socket.SOCK_STREAM)
    addresses = list(dict.fromkeys(str(entry[4][0]) for entry in found))
    if _literal(host) is None:
        for address in addresses:
            reason = _foreign(host, ip_address(address.partition("%")[0]))
            if reason:
                raise UnreachableError(f"its name stands for {address}, {reason}; write that address if it is meant")
    return addresses


def _literal(host: str) -> IPv4Address | IPv6Address | None:
    try:
        return ip_address(host.partition("%")[0])
    except ValueError:
        return None


def _foreign(host: str, address: IPv4Address | IPv6Address) -> str | None:
    """Why an address can't be what a spec means by a name: who answers for names chooses it, and may choose any."""
    own = host.lower().rstrip(".")
    if isinstance(address, IPv6Address) and address.ipv4_mapped:
        address = address.ipv4_mapped
    if address.is_loopback and own not in _own_names() and own.rpartition(".")[2] != "localhost":
        return "this machine itself"
    if address.is_link_local or address.is_multicast or address.is_unspecified:
        return "which is no host's of its own"
    return None


def _own_names() -> set[str]:
    """The names of this machine, which its own tables may give a loopback address."""
    name = socket.gethostname().lower()
    return {name, name.partition(".")[0]}
