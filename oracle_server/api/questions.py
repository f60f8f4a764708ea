"""The query parameters that select verdict records."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from typing import Annotated, Literal

from fastapi import Depends, HTTPException, Query
from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute
from pydantic import StringConstraints
from starlette.requests import HTTPConnection

from oracle_server.core.nearest import either, nearest
from oracle_server.core.verdicts import Outcome
from oracle_server.history.query import Query as Question
from oracle_server.history.views import View


def _none() -> list[str]:
    """No values: of `list` itself pydantic would parse a signature at each request, half a millisecond and garbage."""
    return []


_REPEATABLE = frozenset(("outcome", "part", "property", "signal"))
_BELOW = 2**63
_API = "/api/v1/"
"""Where parameters ask for something; who fetches a page, or looks for life, may send what they like."""
Nanoseconds = Annotated[
    int | None,
    Query(ge=0, lt=_BELOW, description="A publication time in ns, included; of what is skewed its arrival counts"),
]
Number = Annotated[
    int, Query(ge=0, lt=_BELOW, description="The `n` of the last record that was read; records after it follow")
]
Outcomes = Annotated[list[Outcome], Query(default_factory=_none, description="Only these outcomes; repeatable")]
As = Annotated[
    View,
    Query(
        alias="as",
        description="What stands, what was said at first, or all: this and the revisions. "
        "There is no difference where the spec does not revise",
    ),
]
Origin = Annotated[
    Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_.-]{1,64}$")] | None,
    Query(description="Only what is forwarded from the robot of this name"),
]
Properties = Annotated[
    list[str], Query(default_factory=_none, description="Only the properties of these ids; repeatable")
]


async def demand_parameters(connection: HTTPConnection) -> None:
    """Raise 422 for a parameter that says nothing to this route, or is given several times where one counts.

    What it asks for would be missed, and the answer look like one to it.
    """
    given = Counter(name for name, _ in connection.query_params.multi_items())
    route = connection.scope.get("route")
    if given and isinstance(route, APIRoute) and connection.scope["path"].startswith(_API):
        _demand_known(given, _parameters(route.dependant))
    for name, times in given.items():
        if times > 1 and name not in _REPEATABLE:
            raise HTTPException(422, f"query.{name}: it is given {times} times, and can be once")


def _demand_known(given: Iterable[str], known: frozenset[str]) -> None:
    for name in given:
        if name not in known:
            says = nearest(name, known) or (f"there is {either(sorted(known))}" if known else "there is none here")
            raise HTTPException(422, f"query.{name}: there is no such parameter; {says}")


def _parameters(of: Dependant) -> frozenset[str]:
    """The names of the parameters that an endpoint, and what it depends on, can be asked with."""
    return frozenset(field.alias for field in of.query_params).union(*map(_parameters, of.dependencies))


def demand_span(since: int | None, until: int | None) -> None:
    """Raise 422 for a time that ends before it begins: that nothing is found in it would be no good news."""
    if since is not None and until is not None and since > until:
        raise HTTPException(422, "query.since: it is after `until`")


def chosen(
    property: Properties,  # noqa: A002 -- the contract's word
    stream: Annotated[str | None, Query(description="Only events of the topic or service of this name")] = None,
    view: As = "standing",
) -> Question:
    """The question for records of some properties and one stream; of all where none is named."""
    return Question(frozenset(property), stream=stream, view=view)


def paged(
    question: Annotated[Question, Depends(chosen)],
    since: Nanoseconds = None,
    until: Nanoseconds = None,
    after: Number | None = None,
    limit: Annotated[
        int,
        Query(
            ge=1,
            le=1000,
            description="Records in one answer, fewer where they are long; `next` is the `after` of the following page",
        ),
    ] = 100,
    order: Annotated[Literal["asc", "desc"], Query(description="The oldest or the newest first")] = "asc",
) -> Question:
    """The question for one page of records. Raises 422 for a time that ends before it begins."""
    demand_span(since, until)
    return replace(question, since=since, until=until, after=after, limit=limit, order=order)
