"""A route is open to nobody who was not let in: what each declares, and what becomes of one that declares nothing."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from fastapi import APIRouter, FastAPI, WebSocket
from fastapi.routing import iter_route_contexts
from starlette.routing import Mount, Route

from oracle_server.api.app import build_app
from oracle_server.edge.scopes import RouteScopes, UndeclaredRouteError, needs
from oracle_server.edge.tokens import Scope
from oracle_server.history.memory import MemoryHistory
from oracle_server.jobs.checking import Checking
from oracle_server.jobs.recordings import Recordings
from oracle_server.jobs.uploads import Uploads
from oracle_server.process.clock import Clock
from oracle_server.process.watchdog import Watchdog
from oracle_server.sessions.registry import Registry
from oracle_server.specfiles.library import Library


def request(method: str, path: str) -> dict[str, object]:
    return {"type": "http", "method": method, "path": path, "headers": []}


def handshake(path: str) -> dict[str, object]:
    return {"type": "websocket", "path": path, "headers": []}


@pytest.fixture(scope="module")
def app() -> FastAPI:
    with tempfile.TemporaryDirectory() as folder:
        history, library = MemoryHistory(), Library(None, Path(folder))
        registry = Registry(history, library, Clock(), 10.0)
        sent = Recordings(registry, library, Uploads(Path(folder) / "recordings", 0))
        return build_app(registry, library, history, Watchdog(), Checking(), sent)


OPEN = ["/", "/healthz", "/readyz", "/docs", "/docs/swagger-ui.css", "/openapi.json", "/dashboard/main.js"]
NEEDED: list[tuple[str, str, Scope]] = [
    ("GET", "/metrics", "read"),
    ("GET", "/api/v1/specs", "read"),
    ("PUT", "/api/v1/specs/s", "admin"),
    ("POST", "/api/v1/specs/s/check", "admin"),
    ("POST", "/api/v1/recordings", "submit"),
    ("GET", "/api/v1/recordings/r", "submit"),
    ("DELETE", "/api/v1/recordings/r", "submit"),
    ("GET", "/api/v1/sessions", "read"),
    ("POST", "/api/v1/sessions", "submit"),
    ("GET", "/api/v1/sessions/s", "read"),
    ("DELETE", "/api/v1/sessions/s", "admin"),
    ("GET", "/api/v1/sessions/s/stream", "read"),
    ("GET", "/api/v1/sessions/s/trace", "read"),
    ("GET", "/api/v1/sessions/s/verdicts/1/explanation", "read"),
]


def test_what_shows_nothing_of_any_robot_is_open_and_nothing_else(app: FastAPI) -> None:
    scopes = RouteScopes(app.routes)
    for path in OPEN:
        assert scopes.needed(request("GET", path)) is None, path
    told = [route.path or "" for route in iter_route_contexts(app.routes) if route.methods]
    assert {path for path in told if scopes.needed(request("GET", path)) is None} == {
        path for path in told if path in OPEN or path.startswith(("/dashboard/", "/docs/"))
    }


def test_each_route_needs_what_it_declares(app: FastAPI) -> None:
    scopes = RouteScopes(app.routes)
    assert [(m, p, scopes.needed(request(m, p))) for m, p, _ in NEEDED] == NEEDED
    for path in ("/", "/api/v1/attach", "/legacy/s"):
        assert scopes.needed(handshake(path)) == "submit"


@pytest.mark.parametrize(
    "connection",
    [request("GET", "/nowhere"), request("DELETE", "/healthz"), request("PUT", "/")],
)
def test_where_there_is_no_route_a_token_is_needed(app: FastAPI, connection: dict[str, object]) -> None:
    assert RouteScopes(app.routes).needed(connection) == "read"
    assert RouteScopes(app.routes).needed(handshake("/nowhere")) == "submit", "a monitor's has that"


async def undeclared() -> None: ...


async def undeclared_socket(socket: WebSocket) -> None: ...


@pytest.mark.parametrize("nested", [False, True])
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_a_route_that_declares_nothing_stops_the_server_from_starting(app: FastAPI, kind: str, nested: bool) -> None:
    router = APIRouter(prefix="/new")
    if kind == "http":
        router.get("/forgotten")(undeclared)
    else:
        router.websocket("/forgotten")(undeclared_socket)
    outer, made = APIRouter(), FastAPI(openapi_url=None, docs_url=None, redoc_url=None)
    outer.include_router(router)
    made.include_router(outer if nested else router)
    with pytest.raises(UndeclaredRouteError, match=r"^/new/forgotten: declares no scope"):
        RouteScopes(made.routes)


def test_what_is_no_route_of_fastapi_s_is_refused_too() -> None:
    for stray in (Route("/stray", undeclared), Mount("/stray", FastAPI())):
        with pytest.raises(UndeclaredRouteError, match=r"^/stray"):
            RouteScopes([stray])


def test_the_first_route_that_fits_counts_as_it_does_for_the_app() -> None:
    router = APIRouter()
    router.get("/{name}")(needs("admin")(undeclared))

    @router.get("/later")
    @needs(None)
    async def later() -> None: ...

    assert RouteScopes(router.routes).needed(request("GET", "/later")) == "admin"
