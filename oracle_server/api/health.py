"""Health checks: whether the server runs, and whether it can judge."""

from __future__ import annotations

from typing import Literal

from fastapi import HTTPException
from pydantic import BaseModel

from oracle_server.api.routes import Routes
from oracle_server.edge.scopes import needs
from oracle_server.history.port import History


class Health(BaseModel):
    """The answer of a health check that succeeds."""

    status: Literal["ok", "ready", "read_only"]


def router(history: History) -> Routes:
    """The routes of health checks."""
    routes = Routes(tags=["health"])

    @routes.get("/healthz")
    @needs(None)
    async def alive() -> Health:
        """Check that the server runs."""
        return Health(status="ok")

    @routes.get("/readyz")
    @needs(None)
    async def ready() -> Health:
        """Check that the server can judge; 503 while its history can't be written. `read_only`: it is to read alone."""
        if history.read_only is not None:
            return Health(status="read_only")
        if history.failure is not None:
            raise HTTPException(503, f"the history can't be written: {history.failure}")
        return Health(status="ready")

    return routes
