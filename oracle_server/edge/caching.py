"""What may be kept of answers, where these do not say it: by proxies nothing, and by clients what they ask about again.

Without a word a proxy that has a time of its own for answers tells how sessions stood then, as if it were now, and
tells it to those, too, that have no token.
"""

from __future__ import annotations

from starlette.types import ASGIApp, Message, Receive, Scope, Send

_CACHE_CONTROL = b"cache-control"
_ASKED_AGAIN = (_CACHE_CONTROL, b"private, no-cache")


class Caching:
    """ASGI middleware that adds a `Cache-Control` to each answer without one, refusals included."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def said(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = [*message.get("headers", ())]
                if all(name.lower() != _CACHE_CONTROL for name, _ in headers):
                    message = {**message, "headers": [*headers, _ASKED_AGAIN]}
            await send(message)

        await self._app(scope, receive, said)
