"""The scope that each route needs: declared at the route, and looked up before a request is processed."""

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
"""The scope for paths without a route, so that clients without a token can't find out which routes exist."""

Endpoint = TypeVar("Endpoint", bound=Callable[..., Any])


class UndeclaredRouteError(OracleError):
    """A route that declares no scope."""


def needs(scope: Scope | None) -> Callable[[Endpoint], Endpoint]:
    """Declare, directly above an endpoint, the scope that it needs; None makes it public."""

    def declare(endpoint: Endpoint) -> Endpoint:
        setattr(endpoint, _DECLARED, scope)
        return endpoint

    return declare


class RouteScopes:
    """The scopes that the routes of an app have declared."""

    def __init__(self, routes: Sequence[BaseRoute]) -> None:
        """Read the declarations of all routes. Raises `UndeclaredRouteError` where one has none."""
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
