"""A slash too many at the end of a path: where to go instead, from there, as a proxy may put a path before it."""

from __future__ import annotations

from urllib.parse import quote

from starlette.types import ASGIApp, Message, Receive, Scope, Send


class Slashes:
    """ASGI middleware that makes the app's redirects relative: the app does not know at what address it is asked."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on."""
        if scope["type"] != "http" or not scope["path"].endswith("/"):
            await self._app(scope, receive, send)
            return

        async def send_relative(message: Message) -> None:
            if message["type"] == "http.response.start" and message["status"] == 307:
                kept = [(name, value) for name, value in message["headers"] if name != b"location"]
                message = {**message, "headers": [*kept, (b"location", _without_slash(scope))]}
            await send(message)

        await self._app(scope, receive, send_relative)


def _without_slash(scope: Scope) -> bytes:
    path = scope["path"].rstrip("/")
    up = "../" * (len(scope["path"]) - len(path))
    query = b"?" + scope["query_string"] if scope["query_string"] else b""
    return f"{up}{quote(path.rpartition('/')[2], safe='')}".encode() + query
