"""Whether the server runs, and whether it can judge."""

from __future__ import annotations

from typing import Literal

from fastapi import APIRouter, HTTPException
from pydantic import BaseModel

from oracle_server.edge.scopes import needs
from oracle_server.history.port import History


class Health(BaseModel):
    """The server's state in a word."""

    status: Literal["ok", "ready"]


def router(history: History) -> APIRouter:
    """The routes of health checks."""
    made = APIRouter(tags=["health"])

    @made.get("/healthz")
    @needs(None)
    async def alive() -> Health:
        """Tell that the server runs."""
        return Health(status="ok")

    @made.get("/readyz")
    @needs(None)
    async def ready() -> Health:
        """Tell whether the server can judge."""
        if history.failure is not None:
            raise HTTPException(503, f"the history can't be written: {history.failure}")
        return Health(status="ready")

    return made
