"""The API is what its description says: the one in docs/, the one that is served, and what answers."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any
from urllib.parse import urljoin

import hypothesis
import schemathesis
from hypothesis import HealthCheck
from schemathesis.checks import CHECKS

from oracle_server.api.openapi import description
from oracle_server.api.verdicts import RecordPage
from oracle_server.wire.outgoing import Record
from tests.whole.client import attached, make_clock, make_event
from tests.whole.harness import Server

DOCUMENT = Path(__file__).parents[2] / "docs" / "openapi.json"
HELD_TO = [
    "not_a_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_schema_conformance",
    "unsupported_method",
]
# the stream has no end that a case could wait for; tests/whole/test_stream.py reads it
described = schemathesis.openapi.from_path(DOCUMENT).exclude(path_regex="/stream$")


def test_the_document_in_docs_is_that_of_the_code() -> None:
    written = json.loads(DOCUMENT.read_text())
    assert written == description(), "run: python -m oracle_server.api.openapi > docs/openapi.json"


def test_the_document_is_served(server: Server) -> None:
    assert server.http.get("/openapi.json").json() == json.loads(DOCUMENT.read_text())


@described.parametrize()
@hypothesis.settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
def test_whatever_is_asked_is_answered_as_described(case: Any, shared_server: Server) -> None:
    response = case.call(base_url=shared_server.url)
    case.validate_response(response, checks=[CHECKS.get_one(name) for name in HELD_TO])
    if response.status_code >= 400:
        assert response.headers["content-type"][0].split(";")[0] == "application/problem+json"


def test_the_page_needs_nothing_from_elsewhere(server: Server) -> None:
    page = server.http.get("/docs").text
    found = re.findall(r'(?:src|href)="([^"]+)"', page) + re.findall(r"url: '([^']+)'", page)
    assert len(found) == 4
    for path in found:
        assert not path.startswith("/"), "a proxy may put a path before it"
        response = server.http.get(urljoin("/docs", path))
        assert response.status_code == 200
        assert len(response.content) > 100
    assert not re.search(r"https?://", page)


def test_pages_of_other_origins_are_never_let_in(server: Server) -> None:
    asked = {"Access-Control-Request-Method": "PUT", "Access-Control-Request-Headers": "authorization"}
    for headers in ({"Origin": "http://example.org"}, {"Origin": server.url}, {}):
        response = server.http.options("/api/v1/specs/lamp", headers=headers | asked)
        assert response.status_code in (403, 405)
        assert not [name for name in response.headers if name.startswith("access-control")]


async def test_records_are_as_they_are_described(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="timed") as monitor:
        await monitor.send(make_event(1, "/a", at=0), make_clock("/a", 60), make_clock("/b", 60))
        await monitor.violated(1)
        await monitor.acked(1)
    page = server.get(f"sessions/{session}/verdicts")
    assert page.keys() == RecordPage.model_fields.keys()
    assert {r["kind"] for r in page["items"]} == {"topic", "tick"}
    explained = [server.get(f"sessions/{session}/verdicts/{r['n']}/explanation") for r in page["items"]]
    for record in (*page["items"], *explained):
        needed = {name for name, field in Record.model_fields.items() if field.is_required()}
        assert needed <= record.keys() <= Record.model_fields.keys()
        assert Record.model_validate(record).model_dump(mode="json", exclude_unset=True) == record
