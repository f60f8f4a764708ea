"""An app over a history of its own, asked without a socket."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest
from fastapi import FastAPI

from oracle_server.api.app import build_app
from oracle_server.edge.access import Access
from oracle_server.edge.scopes import RouteScopes
from oracle_server.edge.tokens import Tokens
from oracle_server.history.memory import MemoryHistory
from oracle_server.jobs.checking import Checking
from oracle_server.jobs.recordings import Recordings
from oracle_server.jobs.uploads import Uploads
from oracle_server.process.clock import Clock
from oracle_server.process.watchdog import Watchdog
from oracle_server.sessions.registry import Registry
from oracle_server.specfiles.library import Library
from tests.whole.conftest import copy_specs

SPECS = ("brief", "explained", "lamp", "other", "pair", "single", "slow", "texts")
"""What is asked for here; to read all takes as long as all else that a test does."""


@dataclass
class Asked:
    """An app that anybody may ask all of, and its parts."""

    app: FastAPI
    guarded: Access
    registry: Registry
    http: httpx.AsyncClient
    checking: Checking

    def at(self, address: str) -> httpx.AsyncClient:
        """What asks from another address."""
        transport = httpx.ASGITransport(self.guarded, raise_app_exceptions=False, client=(address, 1))
        return httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1")


@pytest.fixture
async def asked(tmp_path: Path) -> AsyncIterator[Asked]:
    library = Library(copy_specs(tmp_path / "specs", SPECS), tmp_path / "put")
    history = MemoryHistory()
    history.start(asyncio.get_running_loop())
    registry = Registry(history, library, Clock(), 10.0)
    checking = Checking()
    sent = Recordings(registry, library, Uploads(tmp_path / "recordings", 2**20))
    app = build_app(registry, library, history, Watchdog(), checking, sent)
    guarded = Access(app, Tokens(tmp_path / "no tokens"), RouteScopes(app.routes))
    transport = httpx.ASGITransport(guarded, raise_app_exceptions=False)
    async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as http:
        yield Asked(app, guarded, registry, http, checking)
    checking.close()
    await sent.stop()
