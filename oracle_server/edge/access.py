"""Authentication by token: 401 without a valid one, 403 beyond its scopes, before the rest of a request is read.

503 where the tokens can't be read: who has a good one comes again.

What a token has opened ends when the token is removed or changed.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple, cast

import structlog
from fastapi import HTTPException
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Receive, Send
from starlette.types import Scope as ConnectionScope

from oracle_server.edge.problems import refuse
from oracle_server.edge.scopes import RouteScopes
from oracle_server.edge.tokens import Grant, Tokens, hash_of
from oracle_server.edge.transport import VISITOR
from oracle_server.edge.visitors import Visitor
from oracle_server.history.readers import reading_for

_RECHECK = 0.5
"""Seconds between two looks at whether tokens were removed."""
_NEEDED = "a token is needed: send `Authorization: Bearer TOKEN`; `oracle-server token add` makes one"
_UNKNOWN = "the token that was sent is not known here: it is mistyped, was removed, or is of another server"
_UNREADABLE = "the server can't read its file of tokens, and lets nobody in until it can; its log says why"

log = structlog.get_logger()


class _Admitted(NamedTuple):
    """A request or WebSocket that goes on: by whose token, what that allowed, and what ends it."""

    offered: str
    grant: Grant
    end: Callable[[], None]


class Access:
    """ASGI middleware that looks up the grant of each request and WebSocket by its `Authorization` header."""

    def __init__(self, app: ASGIApp, tokens: Tokens, scopes: RouteScopes) -> None:
        self._app, self._tokens, self._scopes = app, tokens, scopes
        self._admitted: dict[int, _Admitted] = {}

    async def __call__(self, scope: ConnectionScope, receive: Receive, send: Send) -> None:
        """Refuse a request or WebSocket, or pass it on with its grant."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        token = _bearer(scope)
        grant = await self._tokens.grant(token)
        needed = self._scopes.needed(scope)
        state = scope.setdefault("state", {})
        visitor: Visitor | None = state.get(VISITOR)
        if needed is not None:
            if grant is None and self._tokens.unreadable:  # by 401 adapters would give up, whose tokens may be good
                await refuse(scope, receive, send, 503, _UNREADABLE)
                return
            if grant is None:
                await refuse(scope, receive, send, 401, _UNKNOWN if token else _NEEDED, {"WWW-Authenticate": "Bearer"})
                return
            if not grant.may(needed):
                await refuse(scope, receive, send, 403, f"the token lacks the scope `{needed}`")
                return
            if visitor is not None and not visitor.prove():
                detail = "the server has as many connections as it may have, and accepts no more"
                await refuse(scope, receive, send, 503, detail, {"Connection": "close"})
                return
        state["grant"] = grant
        state["client"] = client = self._client(scope, token)
        with reading_for(client):
            if needed is None or grant is None or visitor is None:
                await self._app(scope, receive, send)
                return
            with self._kept(_Admitted(hash_of(token or ""), grant, visitor.end)):
                await self._app(scope, receive, send)

    def _client(self, scope: ConnectionScope, token: str | None) -> str:
        """For whom the history is read: by token, or by address where none is needed; monitors wait for no reader."""
        if scope["type"] == "websocket":
            return ""
        visitor: Visitor | None = scope["state"].get(VISITOR)
        address = visitor.address if visitor is not None else (scope.get("client") or ("unknown",))[0]
        return hash_of(token) if token and self._tokens.required else f"at {address}"

    @contextmanager
    def _kept(self, admitted: _Admitted) -> Iterator[None]:
        self._admitted[id(admitted)] = admitted
        try:
            yield
        finally:
            del self._admitted[id(admitted)]

    async def watch(self) -> None:
        """End, for as long as this runs, what was opened by a token that is removed or changed."""
        while True:
            await asyncio.sleep(_RECHECK)
            try:
                if await self._tokens.refreshed():
                    self.end_revoked()
            except Exception:  # without this task, what a removed token has opened would go on
                log.exception("it can't be seen whether tokens were removed")

    def end_revoked(self) -> None:
        """End every request and WebSocket whose token does not allow now what it allowed when they began."""
        revoked = [one for one in self._admitted.values() if self._tokens.known(one.offered) != one.grant]
        for one in revoked:
            one.end()
        if revoked:
            log.info("connections were ended, since their token was removed or changed", count=len(revoked))


def grant_of(connection: HTTPConnection) -> Grant:
    """The grant of the sender of a request or WebSocket."""
    return cast("Grant", connection.state.grant)


def client_of(connection: HTTPConnection) -> str:
    """Who the sender of a request is: equal for the same token, or the same address where none is needed."""
    return cast("str", connection.state.client)


def demand(connection: HTTPConnection, *, spec: str | None = None, session: str | None = None) -> None:
    """Raise 403 where the sender's token is bound to other specs or sessions; None matches no bound token."""
    grant = grant_of(connection)
    if not grant.covers(spec=spec, session=session):
        raise HTTPException(403, "the token is bound to other specs or sessions")


def demand_all(connection: HTTPConnection) -> None:
    """Raise 403 where the sender's token is bound to some specs or sessions: what is asked for is of all."""
    if grant_of(connection).bound:
        raise HTTPException(403, "the token is bound to some specs or sessions, and this is of all of them")


def _bearer(scope: ConnectionScope) -> str | None:
    found = [value for name, value in scope["headers"] if name == b"authorization"]
    if len(found) != 1:
        return None
    scheme, _, token = found[0].decode("latin-1").partition(" ")
    return token.strip() if scheme.lower() == "bearer" else None
