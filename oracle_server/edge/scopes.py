"""The scope that each route needs: declared beside the route, looked up before anything of a request is read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from fastapi.routing import iter_route_contexts
from starlette.routing import BaseRoute, Match
from starlette.types import Scope as ConnectionScope

from oracle_server.core.errors import OracleError
from oracle_server.edge.tokens import Scope

_DECLARED = "needed_scope"
_ELSEWHERE: Scope = "read"
"""Needed where there is no route, so that strangers do not find out which routes there are."""

Endpoint = TypeVar("Endpoint", bound=Callable[..., Any])


class UndeclaredRouteError(OracleError):
    """A route that declares no scope."""


def needs(scope: Scope | None) -> Callable[[Endpoint], Endpoint]:
    """Declare, directly above an endpoint, the scope that it needs; None opens it to everybody."""

    def declare(endpoint: Endpoint) -> Endpoint:
        setattr(endpoint, _DECLARED, scope)
        return endpoint

    return declare


class RouteScopes:
    """What the routes of an app have declared."""

    def __init__(self, routes: Sequence[BaseRoute]) -> None:
        """Look at all routes. Raises `UndeclaredRouteError`."""
        self._routes = [(route, _declared(route.endpoint, route.path)) for route in iter_route_contexts(routes)]

    def needed(self, connection: ConnectionScope) -> Scope | None:
        """The scope that a request or the handshake of a WebSocket needs, None where it needs no token."""
        for route, needed in self._routes:
            match, _ = route.matches(connection)
            if match is Match.FULL:
                return needed
        return _ELSEWHERE


def _declared(endpoint: Callable[..., Any] | None, path: str | None) -> Scope | None:
    if not hasattr(endpoint, _DECLARED):
        raise UndeclaredRouteError(f"{path}: declares no scope; put `@needs(…)` directly above its endpoint")
    scope: Scope | None = getattr(endpoint, _DECLARED)
    return scope
