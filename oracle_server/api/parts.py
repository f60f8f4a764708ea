"""The parts of a property's formula by time over HTTP."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Literal

from fastapi import HTTPException, Path, Query, Request, Response
from pydantic import BaseModel, Field

from oracle_server.api.explaining import Explainer
from oracle_server.api.known import demand_session, unknown_verdict
from oracle_server.api.packing import json_answer
from oracle_server.api.routes import Routes
from oracle_server.core.events import Order
from oracle_server.edge.scopes import needs
from oracle_server.history.port import Reading
from oracle_server.review.again import NoExplanationError
from oracle_server.review.parts import MOST_STEPS, Around, parts
from oracle_server.sessions.registry import Registry

_SECOND = 10**9
_LONGEST = 3_600 * _SECOND


class PartModel(BaseModel):
    """A part of a formula. What it was is told from the step at an index on, up to the next entry's."""

    path: list[int] = Field(description="Which part of which part of the whole it is")
    depth: int = Field(description="How many rows of the tree it stands under")
    head: str = Field(description="Its operator, or all of an atom")
    text: str
    name: str | None = Field(description="The name of `define:` that stands for it")
    needs: list[str] = Field(description="The variables whose values it depends on, so that it has no truth by itself")
    waits: bool = Field(description="Whether it waits for what comes, so that it has no truth at a step")
    more: bool = Field(description="Whether it has parts that are left out, as there are too many")
    runs: list[tuple[int, Literal["holds", "fails", "unknown", "not_told"]]]
    signal: str | None = Field(description="Of an atom, the first signal that it reads")
    values: list[tuple[int, bool | int | float | str | None]] = Field(
        description="That signal's values as the formula saw them; null where it had none, or the formula was not "
        "asked, as the outcome was final before"
    )


class PartsModel(BaseModel):
    """What the parts of a formula came to at the steps around a verdict, first the whole, then each above its parts.

    The whole is what was recorded. A part is `unknown` where the whole is, and `not_told` where it has no truth by
    itself, where the outcome was final before, and where judging again does not come out as what was recorded.
    """

    n: int
    property: str
    order: Order
    formula: str
    at: int = Field(
        description="The index of the verdict's step; of the one before, where only other properties were judged"
    )
    times: list[int] = Field(
        description="Of the steps (ns): when they were published; of what is skewed, when it arrived"
    )
    numbers: list[int] = Field(description="The verdict `n` of the property at each step")
    steps: list[int | None] = Field(description="Their numbers; null where they have none")
    outcomes: list[tuple[int, str]] = Field(description="The outcome from the step at an index on")
    robustness: list[float | Literal["Infinity", "-Infinity"] | None] | None
    parts: list[PartModel]
    note: str | None = Field(description="Why parts are not told")
    earlier: bool = Field(description="Whether earlier steps within the time are left out, as there are too many")
    later: bool = Field(description="Whether later ones are")


def router(registry: Registry, history: Reading, explainer: Explainer) -> Routes:
    """The route of formulas by time."""
    routes = Routes(prefix="/api/v1", tags=["verdicts"])

    @routes.get("/sessions/{session_id}/verdicts/{n}/parts", response_model=PartsModel)
    @needs("read")
    async def get_parts(
        request: Request,
        session_id: str,
        n: Annotated[int, Path(ge=1, lt=2**63)],
        within: Annotated[
            int, Query(ge=0, le=_LONGEST, description="Steps up to so long before and after (ns)")
        ] = _SECOND,
        steps: Annotated[int, Query(ge=0, le=MOST_STEPS // 2, description="On each side, at the most")] = 200,
    ) -> Response:
        """Get what each part of a property's formula came to at the steps around a verdict.

        All events before are judged again, as for an explanation, and in turn with these. 409 where that can't be. Of
        sessions whose spec revises it is told what stands, in the order in which it does.
        """
        known = await demand_session(request, registry, session_id)
        try:
            found = await explainer.in_turn(request, partial(parts, history, known, Around(n, within, steps)))
        except NoExplanationError as error:
            raise HTTPException(409, str(error)) from None
        if found is None:
            await unknown_verdict(history, known, n)
        return await json_answer(request, history, found)

    return routes
