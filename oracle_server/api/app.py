"""The app: the routes of the HTTP API, of its pages, and of the WebSockets that monitors attach to."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Depends, FastAPI, WebSocket

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
    return app


def _attach_route(registry: Registry, max_rate: float) -> APIRouter:
    routes = APIRouter()

    @routes.websocket("/api/v1/attach")
    @needs("submit")
    async def attach(socket: WebSocket) -> None:
        await Connection(socket, registry, max_rate).serve()

    return routes
