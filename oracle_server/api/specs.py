"""Specs over HTTP: listed, read, and uploaded."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Any, Literal

from fastapi import Header, HTTPException, Request, Response
from pydantic import BaseModel, Field

from oracle_server.api.known import unknown_spec, visible_specs
from oracle_server.api.leaving import text_of
from oracle_server.api.packing import packed_answer
from oracle_server.api.routes import Routes
from oracle_server.core.derived.words import described
from oracle_server.core.errors import SpecError
from oracle_server.core.kinds import Kind
from oracle_server.core.spec import UNREACHABLE
from oracle_server.core.thresholds import MOST, thresholds
from oracle_server.edge.access import demand, grant_of
from oracle_server.edge.problems import unsound
from oracle_server.edge.scopes import needs
from oracle_server.history.port import Reading
from oracle_server.sessions.registry import Registry
from oracle_server.specfiles.library import Entry, Expected, Library, SpecChangedError, UnknownSpecError, Unsound
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


class DerivedDocument(BaseModel):
    """A derived signal of a spec, and what it is, as in `rate of {topic: /scan} over 2s`."""

    name: str
    signal: str


class ThresholdDocument(BaseModel):
    """A property compares a signal with a number; `signal` is `STREAM:SIGNAL`, as a timeline is asked for it."""

    signal: str
    property: str
    op: str
    value: float


class SpecDocument(BaseModel):
    """A spec; `source` is `file` where it was read from the specs folder, and `put` where it was uploaded."""

    id: str
    description: str
    digest: str
    source: Literal["file", "put"]
    streams: list[StreamDocument]
    properties: list[PropertyDocument]
    derive: list[DerivedDocument] | None = Field(None, description="Where it derives signals: these, in order")
    problem: str | None = Field(
        None,
        description="In the list: why a file is unsound and can't be used, a line a reason; "
        "one that never was sound has neither streams nor properties",
    )
    text: str | None = Field(None, description="For GET of one spec: its text")
    thresholds: list[ThresholdDocument] | None = Field(
        None,
        description=f"For GET of one spec: the numbers that its formulas compare signals with, the first {MOST:,}",
    )
    warnings: list[str] | None = Field(None, description="For PUT: the warnings of `check`")


class SpecList(BaseModel):
    """All specs."""

    items: list[SpecDocument]


Tags = Annotated[str | None, Header(max_length=1000)]
YAML: dict[str, Any] = {"requestBody": {"content": {"application/yaml": {}}}}
"""A body that is the text of a spec."""


def router(library: Library, registry: Registry, history: Reading) -> Routes:
    """The routes of the specs."""
    routes = Routes(prefix="/api/v1", tags=["specs"])

    @routes.get("/specs", response_model=SpecList)
    @needs("read")
    async def list_specs(request: Request) -> Response:
        """List the specs that the token lets you see; `problem` is why a file can't be used."""
        seen = await visible_specs(request, registry)
        listed = await library.in_thread(partial(_listed, library, seen))
        return await packed_answer(request, history, partial(_encoded, listed))

    @routes.get("/specs/{spec_id}", response_model=SpecDocument)
    @needs("read")
    async def get_spec(spec_id: str, request: Request) -> Response:
        """Get a spec with its text; 422 where its file is unsound, with the file's text for who may store another."""
        seen = await visible_specs(request, registry)
        if seen is not None and spec_id not in seen:
            raise HTTPException(403, "the token is bound to other specs or sessions")
        try:
            entry = await library.find(spec_id)
        except UnknownSpecError as error:
            unknown_spec(request, error)
        except SpecError as error:
            text = (
                await library.in_thread(partial(library.written, spec_id)) if grant_of(request).may("admin") else None
            )
            return unsound(error, text)
        answer = await packed_answer(request, history, partial(_shown, entry))
        answer.headers["ETag"] = f'"{entry.tag}"'
        return answer

    @routes.put("/specs/{spec_id}", response_model=SpecDocument, openapi_extra=YAML)
    @needs("admin")
    async def put_spec(
        spec_id: Identifier, request: Request, if_match: Tags = None, if_none_match: Tags = None
    ) -> Response:
        """Validate a spec as `check` does, and store it; open sessions keep theirs. Not by tokens bound to sessions.

        With `If-Match: TAG` only in place of the text with that `ETag`, with `If-None-Match: *` only where there is
        none yet; else 412.
        """
        demand(request, spec=spec_id)
        if spec_id in UNREACHABLE:
            raise HTTPException(422, f"no spec can be called '{spec_id}', which paths leave out; take another name")
        expected = _expected(if_match, if_none_match)
        text = await text_of(request)
        try:
            entry, new = await library.upload(spec_id, text, expected)
        except SpecChangedError as error:
            raise HTTPException(412, str(error)) from None
        except OSError as error:
            raise HTTPException(503, f"the spec can't be kept: {error.strerror}") from None
        answer = await packed_answer(request, history, partial(_stored, entry))
        answer.status_code = 201 if new else 200
        answer.headers["ETag"] = f'"{entry.tag}"'
        return answer

    return routes


def _listed(library: Library, seen: frozenset[str] | None) -> SpecList:
    """All specs, or those of some ids, as their files are now."""
    found = []
    for entry in library.listed():
        if seen is not None and entry.id not in seen:
            continue
        if isinstance(entry, Unsound):
            found.append(_refused(entry))
            continue
        try:
            found.append(_document(library.get(entry.id)))
        except SpecError as error:
            found.append(_document(entry, problem=str(error)))
    return SpecList(items=found)


def _shown(entry: Entry) -> bytes:
    """A spec with its text; of a large one it takes longer than a decision may, and so a thread does it."""
    return _encoded(_document(entry, text=entry.file.text, thresholds=_thresholds(entry)))


def _stored(entry: Entry) -> bytes:
    """A spec that was just stored, with what is doubtful in it; in a thread, too."""
    return _encoded(_document(entry, warnings=[str(w) for w in entry.file.warnings]))


def _encoded(document: BaseModel) -> bytes:
    return document.model_dump_json(exclude_unset=True).encode()


def _refused(entry: Unsound) -> SpecDocument:
    nothing: dict[str, Any] = {"description": "", "digest": "", "streams": [], "properties": []}
    return SpecDocument(id=entry.id, source=entry.source, problem=str(entry.error), **nothing)


def _document(entry: Entry, **more: Any) -> SpecDocument:
    spec = entry.plan.spec
    if spec.derive:
        more["derive"] = [DerivedDocument(name=d.name, signal=described(d)) for d in spec.derive]
    return SpecDocument(
        id=spec.id,
        description=spec.description,
        digest=spec.digest,
        source=entry.source,
        streams=[StreamDocument(name=s.name, kind=s.kind, type=s.type, action=s.action) for s in spec.streams],
        properties=[PropertyDocument(id=p.id, description=p.description, formula=p.text) for p in spec.properties],
        **more,
    )


def _thresholds(entry: Entry) -> list[ThresholdDocument]:
    return [
        ThresholdDocument(signal=f"{t.stream}:{t.signal}", property=t.property, op=t.op, value=t.value)
        for t in thresholds(entry.plan.spec)
    ]


def _expected(if_match: str | None, if_none_match: str | None) -> Expected:
    """What is to be there, by the headers of a request. Raises 422 for what can't be meant."""
    if if_none_match is not None:
        if if_none_match.strip() != "*" or if_match is not None:
            raise HTTPException(422, "header.if-none-match: it is `*` where it is there, and stands alone")
        return "none"
    if if_match is None:
        return None
    if if_match.strip() == "*":
        return "any"
    return frozenset(tag.strip().removeprefix("W/").strip('"') for tag in if_match.split(","))
