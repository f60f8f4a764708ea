"""A server that only reads: what would change something is refused, whatever it is."""

from __future__ import annotations

from starlette.types import ASGIApp, Receive, Scope, Send

from oracle_server.edge.problems import refuse

_READS = frozenset({"GET", "HEAD", "OPTIONS"})


class ReadOnly:
    """ASGI middleware that answers 405 to every request that is no question. Monitors are told by the sessions."""

    def __init__(self, app: ASGIApp, reason: str) -> None:
        self._app, self._reason = app, reason

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse a request, or pass it on."""
        if scope["type"] == "http" and scope["method"] not in _READS:
            await refuse(scope, receive, send, 405, self._reason, {"Allow": "GET, HEAD"})
            return
        await self._app(scope, receive, send)
