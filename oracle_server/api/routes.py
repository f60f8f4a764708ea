"""Routes of one part of the API, which are made where the app takes them."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Any

from fastapi import APIRouter


class Routes(APIRouter):
    """A router whose routes are made once: one that is included makes each of its own, and the app makes it again.

    To make a route takes a thousandth of a second and more, and a server is ready once it has all.
    """

    def __init__(self, *, prefix: str = "", tags: list[str | Enum] | None = None, in_schema: bool = True) -> None:
        """What begins the paths of these routes, their tags, and whether they are described."""
        super().__init__(prefix=prefix, tags=tags, include_in_schema=in_schema)
        self._said: list[tuple[str, Callable[..., Any], dict[str, Any]]] = []

    def add_api_route(self, path: str, endpoint: Callable[..., Any], **said: Any) -> None:
        """Note a route, which the decorators `get`, `put`, … do."""
        self._said.append((path, endpoint, said))

    def add_to(self, app: APIRouter) -> None:
        """Make the routes as ones of an app's router."""
        for path, endpoint, said in self._said:
            own = {
                "tags": [*self.tags, *(said.get("tags") or ())],
                "include_in_schema": self.include_in_schema and said["include_in_schema"],
            }
            app.add_api_route(self.prefix + path, endpoint, **said | own)
