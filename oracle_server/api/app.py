"""The app: the routes of the HTTP API, of its pages, and of the WebSockets that monitors attach to."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Depends, FastAPI, HTTPException, WebSocket

from oracle_server import __version__
from oracle_server.api import (
    checking,
    episodes,
    health,
    metrics,
    pages,
    parts,
    recordings,
    sequence,
    sessions,
    specs,
    stream,
    timeline,
    verdicts,
)
from oracle_server.api.explaining import Explainer
from oracle_server.api.questions import demand_parameters
from oracle_server.attach.connection import Connection
from oracle_server.attach.rosmonitoring import legacy_routes
from oracle_server.core.errors import one_line
from oracle_server.edge import problems
from oracle_server.edge.scopes import needs
from oracle_server.history.port import History
from oracle_server.jobs.checking import Checking
from oracle_server.jobs.forwarding import Progress
from oracle_server.jobs.recordings import Recordings
from oracle_server.process.watchdog import Watchdog
from oracle_server.remote.webhooks import Webhooks
from oracle_server.sessions.registry import Registry
from oracle_server.specfiles.library import Library

ATTACH = "/api/v1/attach"
"""Where monitors attach."""
_NO_UPGRADE = "monitors attach here by a WebSocket; a proxy between must pass on `Upgrade` and `Connection`"
_PREFIX = "; a proxy that puts a path before it must take it away"
_SHOWN = 100
"""Characters of a wrong path that are told."""


class _App(FastAPI):
    """An app whose description says how a token is sent, so that its page can send one, too."""

    def openapi(self) -> dict[str, Any]:
        """The description."""
        document = super().openapi()
        document["components"]["securitySchemes"] = {"token": {"type": "http", "scheme": "bearer"}}
        document["security"] = [{"token": []}, {}]  # none where the server has no tokens
        return document


def build_app(
    registry: Registry,
    library: Library,
    history: History,
    watchdog: Watchdog,
    checks: Checking,
    sent: Recordings,
    webhooks: Webhooks | None = None,
    *,
    legacy: str | None = None,
    legacy_finals: bool = False,
    max_rate: float = 0,
    forwarding: Progress | None = None,
) -> FastAPI:
    """The app over a server's parts; `RouteScopes` looks up the scope that each of its routes needs.

    `legacy` is the spec of the legacy monitors that name none; with `legacy_finals` they are told that an outcome is
    final. Each monitor may send `max_rate` events a second on average; 0 is no limit. `forwarding` is how
    the history is forwarded, if it is.
    """
    app = _App(
        title="oracle-server",
        version=__version__,
        docs_url=None,
        redoc_url=None,
        openapi_url=None,
        servers=[{"url": "."}],  # where the description is, also behind a proxy that puts a path before it
        responses=problems.RESPONSES,
        dependencies=[Depends(demand_parameters)],
    )
    problems.install(app)
    explainer = Explainer(history)
    for routes in (
        health.router(history),
        specs.router(library, registry, history),
        checking.router(checks, history),
        sessions.router(registry, history),
        recordings.router(sent, registry),
        verdicts.router(registry, history, explainer),
        parts.router(registry, history, explainer),
        sequence.router(registry, history),
        episodes.router(registry, history),
        stream.router(registry, history),
        timeline.router(registry, history),
        metrics.router(registry, history, watchdog, webhooks, forwarding),
        pages.router(app),
    ):
        routes.add_to(app.router)
    app.include_router(_attach_route(registry, max_rate))
    app.include_router(legacy_routes(registry, legacy, max_rate, finals=legacy_finals))
    app.include_router(_refusing_route())
    return app


def _attach_route(registry: Registry, max_rate: float) -> APIRouter:
    routes = APIRouter()

    @routes.websocket(ATTACH)
    @needs("submit")
    async def attach(socket: WebSocket) -> None:
        await Connection(socket, registry, max_rate).serve()

    @routes.get(ATTACH, include_in_schema=False)
    @needs("submit")
    async def ask_for_upgrade() -> None:
        raise HTTPException(426, _NO_UPGRADE, {"Upgrade": "websocket"})

    return routes


def _refusing_route() -> APIRouter:
    """Where a monitor attaches by a wrong path, as behind a proxy that leaves its own before it: else that is 403."""
    routes = APIRouter()

    @routes.websocket("/{path:path}")
    @needs("submit")
    async def refuse(socket: WebSocket, path: str) -> None:
        detail = f"no monitor attaches at `/{one_line(path[:_SHOWN])}`, but at `{ATTACH}`{_PREFIX}"
        await socket.send_denial_response(problems.problem(404, detail))

    return routes
