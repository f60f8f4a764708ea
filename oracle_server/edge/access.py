"""Authentication by token: 401 without a valid one, 403 beyond its scopes, before the rest of a request is read."""

from __future__ import annotations

from typing import cast

from fastapi import HTTPException
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Receive, Send
from starlette.types import Scope as ConnectionScope

from oracle_server.edge.problems import refuse
from oracle_server.edge.scopes import RouteScopes
from oracle_server.edge.tokens import Grant, Tokens


class Access:
    """ASGI middleware that looks up the grant of each request and WebSocket by its `Authorization` header."""

    def __init__(self, app: ASGIApp, tokens: Tokens, scopes: RouteScopes) -> None:
        self._app, self._tokens, self._scopes = app, tokens, scopes

    async def __call__(self, scope: ConnectionScope, receive: Receive, send: Send) -> None:
        """Refuse a request or WebSocket, or pass it on with its grant."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        grant = self._tokens.grant(_bearer(scope))
        needed = self._scopes.needed(scope)
        if needed is not None:
            if grant is None:
                challenge = {"WWW-Authenticate": "Bearer"}
                detail = "a token is needed: send `Authorization: Bearer TOKEN`; `oracle-server token add` makes one"
                await refuse(scope, receive, send, 401, detail, challenge)
                return
            if not grant.may(needed):
                await refuse(scope, receive, send, 403, f"the token lacks the scope `{needed}`")
                return
        scope.setdefault("state", {})["grant"] = grant
        await self._app(scope, receive, send)


def grant_of(connection: HTTPConnection) -> Grant:
    """The grant of the sender of a request or WebSocket."""
    return cast("Grant", connection.state.grant)


def demand(connection: HTTPConnection, *, spec: str | None = None, session: str | None = None) -> None:
    """Raise 403 where the sender's token is bound to other specs or sessions; None matches no bound token."""
    grant = grant_of(connection)
    if not grant.covers(spec=spec, session=session):
        raise HTTPException(403, "the token is bound to other specs or sessions")


def demand_spec(connection: HTTPConnection, spec_id: str) -> None:
    """Raise 403 where the sender's token is bound to other specs, whatever sessions it is bound to."""
    bound = grant_of(connection).specs
    if bound is not None and spec_id not in bound:
        raise HTTPException(403, "the token is bound to other specs")


def _bearer(scope: ConnectionScope) -> str | None:
    found = [value for name, value in scope["headers"] if name == b"authorization"]
    if len(found) != 1:
        return None
    scheme, _, token = found[0].decode("latin-1").partition(" ")
    return token.strip() if scheme.lower() == "bearer" else None
