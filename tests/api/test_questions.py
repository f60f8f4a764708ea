"""The parameters by which records are selected."""

from __future__ import annotations

import inspect

import pytest
from fastapi.dependencies.utils import get_dependant
from fastapi.routing import APIRoute

from oracle_server.api import questions
from tests.api.conftest import Asked


def asked(outcome: questions.Outcomes) -> None:
    """A route's question."""


@pytest.mark.parametrize("parameters", [questions.chosen, asked])
def test_a_question_needs_no_signature_to_be_parsed(parameters: object, monkeypatch: pytest.MonkeyPatch) -> None:
    """The signature of a function in C is a text: to parse it takes half a millisecond, at each request."""
    route = APIRoute("/", parameters)  # type: ignore[arg-type]
    fields = get_dependant(path="/", call=route.endpoint).query_params

    def parsed(*_: object, **__: object) -> None:
        raise AssertionError

    monkeypatch.setattr(inspect, "_signature_fromstr", parsed)
    assert [] in [field.get_default() for field in fields]


@pytest.mark.parametrize("what", ["verdicts", "violations", "episodes", "timeline"])
async def test_a_time_that_ends_before_it_begins_is_refused(asked: Asked, what: str) -> None:
    """Nothing is found in it, which would look like good news."""
    await open_pair(asked)
    path = f"/api/v1/sessions/s/{what}"
    assert (await asked.http.get(path, params={"since": 2, "until": 2})).status_code == 200
    response = await asked.http.get(path, params={"since": 3, "until": 2})
    assert (response.status_code, response.json()["detail"]) == (422, "query.since: it is after `until`")


async def test_a_time_of_all_sessions_that_ends_before_it_begins_is_refused(asked: Asked) -> None:
    assert (await asked.http.get("/api/v1/episodes", params={"since": 3, "until": 2})).status_code == 422


@pytest.mark.parametrize(
    "path", ["verdicts?stream=/a&stream=/b", "violations?stream=/a&stream=/a", "sequence?limit=1&limit=2"]
)
async def test_what_can_be_asked_for_once_is_refused_where_it_is_given_again(asked: Asked, path: str) -> None:
    """Of two streams one alone would be told, as if nothing were wrong with the other."""
    await open_pair(asked)
    response = await asked.http.get(f"/api/v1/sessions/s/{path}")
    name = "limit" if "limit" in path else "stream"
    said = f"query.{name}: it is given 2 times, and can be once"
    assert (response.status_code, response.json()["detail"]) == (422, said)


@pytest.mark.parametrize(
    ("method", "path", "detail"),
    [
        (
            "GET",
            "sessions/s/verdicts?propertys=x",
            "query.propertys: there is no such parameter; did you mean `property`?",
        ),
        ("GET", "sessions/s/violations?untill=1", "query.untill: there is no such parameter; did you mean `until`?"),
        ("GET", "sessions/s/violations?view=all", "query.view: there is no such parameter; there is after or as or"),
        ("GET", "sessions/s/episodes?origin=r", "query.origin: there is no such parameter; there is after or limit or"),
        ("GET", "sessions/s/stream?since=1", "query.since: there is no such parameter; there is after or as or"),
        ("GET", "sessions/s/trace?property=x", "query.property: there is no such parameter; there is none here"),
        ("GET", "sessions?spec=pair", "query.spec: there is no such parameter; there is brief or origin"),
        ("POST", "sessions?id=t", "query.id: there is no such parameter; there is none here"),
        ("DELETE", "sessions/s?confirm=no", "query.confirm: there is no such parameter; there is none here"),
    ],
)
async def test_a_parameter_that_there_is_not_is_refused(asked: Asked, method: str, path: str, detail: str) -> None:
    """What it was to ask for would be missed, and the answer be read as one to it."""
    await open_pair(asked)
    response = await asked.http.request(method, f"/api/v1/{path}", json={"spec": "pair"} if method == "POST" else None)
    assert (response.status_code, response.json()["detail"][: len(detail)]) == (422, detail)
    assert [state["id"] for state in (await asked.http.get("/api/v1/sessions")).json()["items"]] == ["s"]
    assert (await asked.http.get("/api/v1/sessions/s")).json()["status"] != "closed"


@pytest.mark.parametrize("path", ["/", "/healthz", "/metrics", "/dashboard/main.js"])
async def test_what_asks_for_nothing_may_have_any_parameter(asked: Asked, path: str) -> None:
    """Probes and pages are fetched with some that keep caches from answering."""
    assert (await asked.http.get(path, params={"t": "1"})).status_code == 200


async def test_what_can_be_asked_for_again_and_again_is_told(asked: Asked) -> None:
    await open_pair(asked)
    path = "/api/v1/sessions/s/verdicts?outcome=false&outcome=true&property=b_after_a&property=b_after_a"
    assert (await asked.http.get(path)).status_code == 200
    path = "/api/v1/sessions/s/timeline?part=steps&part=lanes&signal=/a:v&signal=/b:mode"
    assert (await asked.http.get(path)).status_code == 200


async def open_pair(asked: Asked) -> None:
    response = await asked.http.post("/api/v1/sessions", json={"spec": "pair", "id": "s"})
    assert response.status_code == 201
