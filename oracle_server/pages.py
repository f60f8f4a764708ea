"""`/docs`: the API to try out, from files that are served here, so that it works where there is no other network."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from importlib.resources import files

from fastapi import APIRouter
from fastapi.openapi.docs import get_swagger_ui_html
from fastapi.responses import HTMLResponse, Response

_FILES = {
    "swagger-ui-bundle.js": "text/javascript",
    "swagger-ui.css": "text/css",
    "favicon.png": "image/png",
}


def router() -> APIRouter:
    """The page and its files."""
    made = APIRouter(include_in_schema=False)
    folder = files("fastapi_offline") / "static"

    @made.get("/docs")
    async def docs() -> HTMLResponse:
        return get_swagger_ui_html(
            openapi_url="/openapi.json",
            title="oracle-server",
            swagger_js_url="/docs/swagger-ui-bundle.js",
            swagger_css_url="/docs/swagger-ui.css",
            swagger_favicon_url="/docs/favicon.png",
        )

    for name, kind in _FILES.items():
        made.add_api_route(f"/docs/{name}", _serving((folder / name).read_bytes(), kind))
    return made


def _serving(content: bytes, kind: str) -> Callable[[], Awaitable[Response]]:
    async def serve() -> Response:
        return Response(content, media_type=kind, headers={"Cache-Control": "max-age=86400"})

    return serve
