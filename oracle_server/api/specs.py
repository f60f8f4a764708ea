"""Specs over HTTP: listed, read, and uploaded."""

from __future__ import annotations

import asyncio
from typing import Any, Literal

from fastapi import APIRouter, HTTPException, Request, Response
from pydantic import BaseModel, Field
from starlette.requests import ClientDisconnect

from oracle_server.core.errors import SpecError
from oracle_server.core.kinds import Kind
from oracle_server.edge.access import demand_spec, grant_of
from oracle_server.edge.scopes import needs
from oracle_server.specfiles.library import Entry, Library, UnknownSpecError
from oracle_server.wire.incoming import Identifier


class StreamDocument(BaseModel):
    """A stream of a spec; `type` is its ROS type, empty for any."""

    name: str
    kind: Kind
    type: str
    action: Literal["log", "filter"]


class PropertyDocument(BaseModel):
    """A property of a spec."""

    id: str
    description: str
    formula: str


class SpecDocument(BaseModel):
    """A spec; `source` is `file` where it was read from the specs folder, and `put` where it was uploaded."""

    id: str
    description: str
    digest: str
    source: Literal["file", "put"]
    streams: list[StreamDocument]
    properties: list[PropertyDocument]
    problem: str | None = Field(None, description="In the list: why a file that has changed can't be used")
    text: str | None = Field(None, description="For GET of one spec: its text")
    warnings: list[str] | None = Field(None, description="For PUT: the warnings of `check`")


class SpecList(BaseModel):
    """All specs."""

    items: list[SpecDocument]


def router(library: Library) -> APIRouter:
    """The routes of the specs."""
    routes = APIRouter(prefix="/api/v1", tags=["specs"])

    def listed(spec_id: str) -> SpecDocument:
        try:
            return _document(library.get(spec_id))
        except SpecError as error:
            return _document(library.last(spec_id), problem=str(error))

    @routes.get("/specs", response_model_exclude_unset=True)
    @needs("read")
    async def list_specs(request: Request) -> SpecList:
        """List all specs; `problem` is why a file that has changed can't be used."""
        bound = grant_of(request).specs
        return SpecList(items=[listed(spec_id) for spec_id in library.ids() if bound is None or spec_id in bound])

    @routes.get("/specs/{spec_id}", response_model_exclude_unset=True)
    @needs("read")
    async def get_spec(spec_id: str, request: Request) -> SpecDocument:
        """Get a spec with its text."""
        demand_spec(request, spec_id)
        try:
            entry = library.get(spec_id)
        except UnknownSpecError as error:
            raise HTTPException(404, str(error)) from None
        return _document(entry, text=entry.file.text)

    @routes.put(
        "/specs/{spec_id}",
        response_model_exclude_unset=True,
        openapi_extra={"requestBody": {"content": {"application/yaml": {}}}},
    )
    @needs("admin")
    async def put_spec(spec_id: Identifier, request: Request, response: Response) -> SpecDocument:
        """Validate a spec as `check` does, and store it; open sessions keep the version that they were opened with."""
        demand_spec(request, spec_id)
        text = await _text(request)
        try:
            entry, new = await asyncio.to_thread(library.put, spec_id, text)
        except OSError as error:
            raise HTTPException(503, f"the spec can't be kept: {error.strerror}") from None
        response.status_code = 201 if new else 200
        return _document(entry, warnings=[str(w) for w in entry.file.warnings])

    return routes


def _document(entry: Entry, **more: Any) -> SpecDocument:
    spec = entry.plan.spec
    return SpecDocument(
        id=spec.id,
        description=spec.description,
        digest=spec.digest,
        source=entry.source,
        streams=[StreamDocument(name=s.name, kind=s.kind, type=s.type, action=s.action) for s in spec.streams],
        properties=[PropertyDocument(id=p.id, description=p.description, formula=p.text) for p in spec.properties],
        **more,
    )


async def _text(request: Request) -> str:
    try:
        body = await request.body()
    except ClientDisconnect:
        raise HTTPException(400, "the client disconnected before the end of the body") from None
    try:
        return body.decode()
    except UnicodeDecodeError:
        raise HTTPException(422, "not UTF-8 text") from None
