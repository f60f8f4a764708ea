"""Recordings over HTTP: sent, judged as sessions of their own, and cancelled."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Literal

from fastapi import HTTPException, Query, Request
from pydantic import BaseModel, Field
from starlette.requests import ClientDisconnect

from oracle_server.api.known import demand_name, unknown_spec
from oracle_server.api.routes import Routes
from oracle_server.edge.access import client_of, demand, grant_of
from oracle_server.edge.scopes import needs
from oracle_server.jobs.checking import CrowdedError
from oracle_server.jobs.recordings import Recording, Recordings, UnwantedError
from oracle_server.jobs.uploads import FullError, TooLargeError
from oracle_server.sessions.opening import SessionExistsError, SessionNameError
from oracle_server.sessions.registry import Registry
from oracle_server.specfiles.library import UnknownSpecError
from oracle_server.wire.incoming import Identifier

PATH = "/api/v1/recordings"
_ENDED_WITHIN = 10.0
"""Seconds that who cancels waits for the end."""
_STATUSES: dict[type[Exception], int] = {
    SessionExistsError: 409, UnwantedError: 409, TooLargeError: 413, SessionNameError: 422, CrowdedError: 429,
    FullError: 507,
}  # fmt: skip
"""What tells a client why its recording is not taken."""


class RecordingDocument(BaseModel):
    """A recording, and how far it has got."""

    id: str
    name: str
    spec: str
    session: str | None = Field(description="The one in which it is judged; null until there is something to judge")
    state: Literal["receiving", "queued", "judging", "judged", "failed", "cancelled"]
    size: int = Field(description="Bytes")
    events: int = Field(description="That were judged so far")
    read: int = Field(description="What was read so far of `total`, in the same unit")
    total: int
    error: str | None = Field(description="Why it was not judged to its end")
    exit: int | None = Field(description="The exit status that `replay` would have: 0, or 1 for violations, 3 unjudged")
    notes: list[str] = Field(description="What is to be known of it, as `replay` says it")


class RecordingList(BaseModel):
    """Recordings, the newest first."""

    items: list[RecordingDocument]


def router(recordings: Recordings, registry: Registry) -> Routes:
    """The routes of recordings."""
    routes = Routes(prefix="/api/v1", tags=["recordings"])

    @routes.post(
        "/recordings", status_code=202, openapi_extra={"requestBody": {"content": {"application/octet-stream": {}}}}
    )
    @needs("submit")
    async def send_recording(
        request: Request,
        spec: Annotated[Identifier, Query(description="The spec that it is judged by")],
        name: Annotated[str, Query(min_length=1, max_length=200, description="The file's name")] = "recording",
        session: Annotated[Identifier | None, Query(description="The name of its session; none has it yet")] = None,
    ) -> RecordingDocument:
        """Send a recording to be judged as a session.

        It is a bag of ROS 1, a file of a ROS 2 bag, or its folder packed by tar, MCAP, or JSON Lines. It is
        judged behind others, one of each client at a time, as `replay` judges it. Its times are the recording's.
        """
        demand(request, spec=spec, session=session)
        await demand_name(request, registry, session)
        with _answered(request):
            await registry.demand_free(session)
            one = await recordings.take(client_of(request), name, spec, session, request.stream(), _announced(request))
        return _document(one)

    @routes.get("/recordings")
    @needs("submit")
    async def list_recordings(request: Request) -> RecordingList:
        """List recordings that were sent since the server started, the newest first: the last hundred."""
        grant = grant_of(request)
        seen = [one for one in recordings.listed() if grant.covers(spec=one.spec, session=one.session)]
        return RecordingList(items=[_document(one) for one in seen])

    @routes.get("/recordings/{recording_id}")
    @needs("submit")
    async def get_recording(request: Request, recording_id: str) -> RecordingDocument:
        """Get how far a recording has got."""
        return _document(_found(request, recordings, recording_id))

    @routes.delete("/recordings/{recording_id}")
    @needs("submit")
    async def cancel_recording(request: Request, recording_id: str) -> RecordingDocument:
        """Cancel a recording that one has sent oneself, unless one may do all; what was judged of it is kept.

        Its state says whether it has ended: while the history can't be written it has not.
        """
        one = _found(request, recordings, recording_id)
        if one.client != client_of(request) and not grant_of(request).may("admin"):
            raise HTTPException(403, "the recording is another client's")
        await recordings.cancel(one, _ENDED_WITHIN)
        return _document(one)

    return routes


@contextmanager
def _answered(request: Request) -> Iterator[None]:
    """Answer why a recording is not taken."""
    try:
        yield
    except UnknownSpecError as error:
        unknown_spec(request, error)
    except ClientDisconnect:
        raise HTTPException(400, "the client disconnected before the end of the recording") from None
    except tuple(_STATUSES) as error:
        raise HTTPException(_STATUSES[type(error)], str(error)) from None


def _found(request: Request, recordings: Recordings, recording_id: str) -> Recording:
    one = recordings.find(recording_id)
    if one is None or not grant_of(request).covers(spec=one.spec, session=one.session):
        raise HTTPException(404, f"no recording '{recording_id}' is known")
    return one


def _announced(request: Request) -> int:
    length = request.headers.get("content-length", "")
    return int(length) if length.isdecimal() and len(length) < 19 else 0


def _document(one: Recording) -> RecordingDocument:
    conclusion = one.conclusion or {}
    return RecordingDocument(
        id=one.id,
        name=one.name,
        spec=one.spec,
        session=one.session if one.opened else None,
        state=one.state,
        size=one.size,
        events=one.events,
        read=one.read,
        total=one.total,
        error=one.error,
        exit=conclusion.get("exit"),
        notes=[
            *(f"{each['property']} was not judged: {each['reason']}" for each in conclusion.get("unjudged", ())),
            *conclusion.get("notes", ()),
            *conclusion.get("warnings", ()),
        ],
    )
