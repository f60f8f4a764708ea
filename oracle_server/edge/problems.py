"""HTTP errors as RFC 9457 defines them: `application/problem+json`."""

from __future__ import annotations

from http import HTTPStatus
from typing import Any

import structlog
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel
from starlette.exceptions import HTTPException
from starlette.routing import Match, Route
from starlette.types import Receive, Scope, Send

from oracle_server.core.errors import HistoryError, SpecError
from oracle_server.process.shortage import shortage
from oracle_server.wire.errors import WireError
from oracle_server.wire.incoming import why

log = structlog.get_logger()


def problem(status: int, detail: str, **more: Any) -> JSONResponse:
    """A response with an error."""
    body = {"type": "about:blank", "title": HTTPStatus(status).phrase, "status": status, "detail": detail, **more}
    return JSONResponse(body, status, media_type="application/problem+json")


def unsound(error: SpecError, text: str | None = None) -> JSONResponse:
    """A response that tells what is wrong with a spec, and where, with its text, if any."""
    found = [{"line": f.line, "column": f.column, "message": f.message} for f in error.findings]
    return problem(422, str(error), errors=found, **({} if text is None else {"text": text}))


class Problem(BaseModel):
    """An error as in RFC 9457; `errors` are its places, in a spec or in a request, `text` that of an unsound spec."""

    type: str
    title: str
    status: int
    detail: str
    errors: list[dict[str, Any]] | None = None
    text: str | None = None


_CONTENT = {"application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}}
RESPONSES: dict[int | str, dict[str, Any]] = {
    "4XX": {"description": "The request can't be answered", "model": Problem, "content": _CONTENT},
    "5XX": {"description": "The server can't answer the request at present", "content": _CONTENT},
}


async def refuse(
    scope: Scope, receive: Receive, send: Send, status: int, detail: str, headers: dict[str, str] | None = None
) -> None:
    """Answer a request, or the handshake of a WebSocket, with a problem."""
    response = problem(status, detail)
    response.headers.update(headers or {})
    if scope["type"] == "websocket":
        await receive()
        if "websocket.http.response" not in scope.get("extensions", {}):
            await send({"type": "websocket.close", "code": 1008, "reason": detail})
            return
    await response(scope, receive, send)


def install(app: FastAPI) -> None:
    """Answer every error of an app by a problem."""

    @app.exception_handler(HTTPException)
    async def _http(request: Request, error: HTTPException) -> JSONResponse:
        response = problem(error.status_code, str(error.detail))
        response.headers.update(error.headers or {})
        if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:  # each method has a route, and the first one's was told
            response.headers["Allow"] = ", ".join(sorted(_methods(request)))
        return response

    @app.exception_handler(RequestValidationError)
    async def _invalid(_: Request, error: RequestValidationError) -> JSONResponse:
        found = [{"where": ".".join(str(part) for part in e["loc"]), "message": why(e)} for e in error.errors()]
        return problem(422, f"{found[0]['where']}: {found[0]['message']}", errors=found)

    @app.exception_handler(SpecError)
    async def _spec(_: Request, error: SpecError) -> JSONResponse:
        return unsound(error)

    @app.exception_handler(WireError)
    async def _stopping(_: Request, error: WireError) -> JSONResponse:
        return problem(503, error.message)

    @app.exception_handler(HistoryError)
    async def _history(_: Request, error: HistoryError) -> JSONResponse:
        log.error("the history can't be read", reason=str(error))
        return problem(503, str(error))

    @app.exception_handler(Exception)
    async def _bug(_: Request, error: Exception) -> JSONResponse:
        short = shortage(error)
        return problem(503, short) if short else problem(500, "the server failed to answer; see its log")


def _methods(request: Request) -> set[str]:
    """The methods by which there is anything at the path of a request."""
    routes = [route for route in request.app.routes if isinstance(route, Route)]
    found = [route.methods or () for route in routes if route.matches(request.scope)[0] is not Match.NONE]
    methods = {method for each in found for method in each}
    return methods | {"HEAD"} if "GET" in methods else methods
