"""The pages for browsers: `/`, the dashboard, and `/docs`, the API to try out.

All their files are served from here, so that they work without another network.
"""

from __future__ import annotations

import asyncio
import re
from base64 import b64encode
from hashlib import sha256
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import PurePath

from fastapi import FastAPI, Request
from fastapi.openapi.docs import get_swagger_ui_html
from fastapi.responses import Response

from oracle_server.api.packing import File
from oracle_server.api.routes import Routes
from oracle_server.edge.scopes import needs
from oracle_server.wire.json import encode_bytes

_TYPES = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
_POLICY = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; " + (
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""The dashboard shows data from robots; with this policy a browser runs none of it, even where it is injected."""
_INLINE = re.compile(r"<script>(.*?)</script>", re.DOTALL)
_DASHBOARD = {
    "Cache-Control": "no-cache",
    "Content-Security-Policy": _POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}
_KEPT = {"Cache-Control": "max-age=86400"}
_DOCS = {
    "swagger-ui-bundle.js": "text/javascript",
    "swagger-ui.css": "text/css",
    "favicon.png": "image/png",
}


def router(app: FastAPI) -> Routes:
    """The routes of the pages, their files, and the description of an app's API."""
    routes = Routes(in_schema=False)
    _add_dashboard(routes, files("oracle_server") / "dashboard")
    _add_docs(routes, files("fastapi_offline") / "static")

    described: list[File] = []

    @routes.get("/openapi.json")
    @needs(None)
    async def describe(request: Request) -> Response:
        if not described:  # once, and in a thread: it takes some tenths of a second, in which no decision was made
            described.append(await asyncio.to_thread(_description, app))
        return await described[0].answer(request)

    return routes


def _description(app: FastAPI) -> File:
    return File(encode_bytes(app.openapi()), "application/json", {"Cache-Control": "no-cache"})


def _add_dashboard(routes: Routes, folder: Traversable) -> None:
    _add_file(routes, "/", (folder / "index.html").read_bytes(), "text/html", _DASHBOARD)
    for file in folder.iterdir():
        kind = _TYPES.get(PurePath(file.name).suffix)
        if kind is not None:
            _add_file(routes, f"/dashboard/{file.name}", file.read_bytes(), kind, _DASHBOARD)


def _add_docs(routes: Routes, folder: Traversable) -> None:
    page = bytes(
        get_swagger_ui_html(  # addresses are relative, so that it works behind a proxy that puts a path before them
            openapi_url="openapi.json",
            title="oracle-server",
            swagger_js_url="docs/swagger-ui-bundle.js",
            swagger_css_url="docs/swagger-ui.css",
            swagger_favicon_url="docs/favicon.png",
        ).body
    )
    _add_file(routes, "/docs", page, "text/html", _DASHBOARD | {"Content-Security-Policy": _docs_policy(page.decode())})

    for name, kind in _DOCS.items():
        _add_file(routes, f"/docs/{name}", (folder / name).read_bytes(), kind, _KEPT)


def _docs_policy(page: str) -> str:
    """The policy for the API's page: its script is allowed by its hash, and its library draws by styles and images."""
    hashes = [b64encode(sha256(script.encode()).digest()).decode() for script in _INLINE.findall(page)]
    scripts = " ".join(["script-src 'self'", *(f"'sha256-{found}'" for found in hashes)])
    return (
        _POLICY.replace("script-src 'self'", scripts)
        .replace("style-src 'self'", "style-src 'self' 'unsafe-inline'")
        .replace("img-src 'self'", "img-src 'self' data:")
    )


def _add_file(routes: Routes, path: str, content: bytes, kind: str, headers: dict[str, str]) -> None:
    file = File(content, kind, headers)

    @routes.get(path)
    @needs(None)
    async def serve(request: Request) -> Response:
        return await file.answer(request)
