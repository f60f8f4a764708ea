"""The events around a moment over HTTP, for sequence diagrams."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import Depends, HTTPException, Query, Request, Response
from pydantic import BaseModel, Field

from oracle_server.api.known import demand_properties, demand_session, unknown_verdict
from oracle_server.api.leaving import unless_left
from oracle_server.api.packing import json_answer
from oracle_server.api.routes import Routes
from oracle_server.core.events import Order, Released
from oracle_server.edge.scopes import needs
from oracle_server.history.port import Reading
from oracle_server.review.sequence import MOST, NowhereError, Wanted, sequence
from oracle_server.sessions.registry import Registry
from oracle_server.wire.outgoing import WaitedRecord

Number = Annotated[int | None, Query(ge=1, lt=2**63)]


class Violated(BaseModel):
    """A property that is violated at an event."""

    property: str
    n: int = Field(description="The number of its verdict")


class ItemModel(BaseModel):
    """An event, or a deadline that ran out (`kind` is `tick`); times in nanoseconds."""

    n: int = Field(description="The verdict of the property that was asked for, else of one with the gravest outcome")
    outcome: str = Field(description="That verdict's")
    step: int | None
    stamp: int = Field(description="When it was published")
    arrived: int
    held: int | None = Field(description="How long it waited to be judged; null where the session's time is simulated")
    released: Released | None = Field(description="Why the order of publication released it")
    waited: list[WaitedRecord] = Field(
        description="The streams that it waited for last, 8 at most: they released it, or were behind it still"
    )
    stream: str
    kind: str
    monitor: str
    seq: int
    row: int | None = Field(description="Which element of its message, from 0; null where the message is one step")
    source: str = Field(description="Who published it, where the monitor tells that; else empty")
    call: int | None = Field(description="Equal for what belongs to one call")
    goal_id: str | None = Field(description="Equal for what belongs to one goal")
    status: str | None
    late: bool
    skewed: bool
    judged: bool = Field(description="Whether it was judged: not, where the spec skips late events")
    lost: int = Field(description="Messages of its stream known to be lost just before it")
    asked: bool = Field(description="Whether its monitor waited for a decision")
    decision: Literal["allow", "deny"] | None
    denied_by: list[str]
    passed: bool | None = Field(description="Whether the adapter passed it on; null while that is not known")
    violated: list[Violated] = Field(description="The first ten properties that are")
    signals: dict[str, bool | int | float | str] = Field(description="Its own, the first six")
    more_signals: int = Field(description="How many further ones it has")


class SequenceModel(BaseModel):
    """Events in the order in which they were judged."""

    order: Order
    items: list[ItemModel]
    left_out: int = Field(description="Events between them that do not concern the property")
    earlier: int | None = Field(description="The `before` of the events before these; null where there are none")
    later: int | None = Field(description="The `after` of those behind them; null where there are none yet")


def wanted(
    n: Annotated[Number, Query(description="Those around this verdict")] = None,
    at: Annotated[int | None, Query(ge=0, lt=2**63, description="Those around this time (ns)")] = None,
    before: Annotated[Number, Query(description="Those before this verdict: the `earlier` of another answer")] = None,
    after: Annotated[Number, Query(description="Those after this verdict: the `later` of another answer")] = None,
    limit: Annotated[int, Query(ge=1, le=MOST, description="Events in one answer")] = 40,
    property: Annotated[  # noqa: A002 -- the contract's word
        str | None,
        Query(max_length=200, description="Only those of streams that it reads or guards, and its deadlines"),
    ] = None,
    others: Annotated[bool, Query(description="With `property`: what does not concern it, too")] = False,
) -> Wanted:
    """The question for one diagram."""
    if sum(each is not None for each in (n, at, before, after)) > 1:
        raise HTTPException(422, "query: give one of `n`, `at`, `before` and `after`")
    return Wanted(n, at, before, after, limit, property, others)


def router(registry: Registry, history: Reading) -> Routes:
    """The route of sequences."""
    routes = Routes(prefix="/api/v1", tags=["verdicts"])

    @routes.get("/sessions/{session_id}/sequence", response_model=SequenceModel)
    @needs("read")
    async def get_sequence(request: Request, session_id: str, question: Annotated[Wanted, Depends(wanted)]) -> Response:
        """Get the events around a moment, with who sent them and what was decided; the last ones, where none is named.

        Of a session that is judged in two orders, those of the order of the verdict that is named.
        """
        known = await demand_session(request, registry, session_id)
        demand_properties(known, [question.property] if question.property is not None else [])
        try:
            found = await unless_left(request, sequence(history, known, question))
        except NowhereError as error:
            await unknown_verdict(history, known, error.n)
        return await json_answer(request, history, found)

    return routes
