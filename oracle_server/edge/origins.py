"""Protection against web pages of other origins: only known Host and Origin headers are let in."""

from __future__ import annotations

from collections.abc import Iterable
from ipaddress import IPv6Address, ip_address
from urllib.parse import urlsplit

from starlette.types import ASGIApp, Receive, Scope, Send

from oracle_server.edge.problems import refuse

_PROXY = "; a proxy between must pass on the `Host` that it was asked for"
_LOOPBACK = ("localhost", "127.0.0.1", "::1")


class Origins:
    """ASGI middleware that answers 421 to a foreign Host and 403 to a foreign Origin, for HTTP and WebSockets.

    Binding to loopback is not enough: any page in a browser on this machine can connect to it.
    """

    def __init__(self, app: ASGIApp, hosts: Iterable[str] = ()) -> None:
        """Let in requests for `hosts` and for the names of loopback."""
        self._app = app
        self._hosts = frozenset(_own(host.lower()) for host in (*_LOOPBACK, *hosts))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse a request or WebSocket, or pass it on."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {name: value.decode("latin-1") for name, value in scope["headers"]}
        own_address = (scope.get("server") or ("",))[0]
        refusal = self._refusal(headers.get(b"host", ""), headers.get(b"origin"), own_address)
        if refusal is None:
            await self._app(scope, receive, send)
            return
        await refuse(scope, receive, send, *refusal)

    def _refusal(self, host: str, origin: str | None, own_address: str) -> tuple[int, str] | None:
        name = _name(host) or ""
        known = _plain(name) in self._hosts or _plain(name) == _plain(own_address)
        if not name or not known:  # DNS rebinding needs a name, not an address
            return 421, f"this server does not answer for the host '{name}'; ORACLE_ALLOWED_HOSTS names further ones"
        if origin is not None and _location(origin) != host.lower():
            return 403, f"pages of another origin may not use this server{_PROXY}"
        return None


def _own(host: str) -> str:
    """A name or an address that is let in, without what a URL, or a `Host`, has around it, as brackets and a port."""
    host = host.rpartition("//")[2]
    if host.count(":") > 1 and "[" not in host:  # an address of IPv6, whose end would be taken for a port
        return _plain(host)
    return _plain(_name(host) or host)


def _plain(name: str) -> str:
    """A name as it is; an address as all that mean it write it.

    Where `::` is bound, IPv4 comes by addresses of IPv6, and link-local ones have an interface behind them.
    """
    try:
        address = ip_address(name)
    except ValueError:
        return name
    if isinstance(address, IPv6Address):
        address = address.ipv4_mapped or IPv6Address(int(address))
    return str(address)


def _location(origin: str) -> str | None:
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:
        return None


def _name(host: str) -> str | None:
    try:
        return urlsplit(f"//{host}").hostname
    except ValueError:
        return None
