"""Answers are compressed for who reads that, and files are sent once."""

from __future__ import annotations

import gzip
import json

import pytest

from tests.whole.client import attached, make_event, make_events
from tests.whole.conftest import Starts
from tests.whole.harness import Server

PAGES = ("/", "/dashboard/main.js", "/dashboard/style.css", "/docs/swagger-ui-bundle.js")


def raw(server: Server, path: str, **headers: str) -> tuple[int, dict[str, str], bytes]:
    """A status, headers and the body as it is sent; without a header of its own no coding is asked for."""
    wanted = {"Accept-Encoding": "identity", **{name.replace("_", "-"): value for name, value in headers.items()}}
    with server.http.stream("GET", path, headers=wanted) as response:
        return response.status_code, dict(response.headers), b"".join(response.iter_raw())


@pytest.mark.parametrize("path", PAGES)
def test_a_file_is_compressed_and_kept(server: Server, path: str) -> None:
    status, plain, body = raw(server, path)
    assert (status, "content-encoding" in plain, plain["vary"]) == (200, False, "Accept-Encoding")
    status, packed, shorter = raw(server, path, Accept_Encoding="br, gzip;q=0.8")
    assert (status, packed["content-encoding"], packed["vary"]) == (200, "gzip", "Accept-Encoding")
    assert gzip.decompress(shorter) == body
    assert len(shorter) < len(body)
    assert packed["etag"] != plain["etag"], "they differ in their bytes"
    assert {k: packed[k] for k in ("content-type", "cache-control")} == {
        k: plain[k] for k in ("content-type", "cache-control")
    }
    for headers, tag in (({}, plain["etag"]), ({"Accept_Encoding": "gzip"}, packed["etag"])):
        for known in (tag, f"W/{tag}", f'"x", {tag}', "*"):
            status, again, nothing = raw(server, path, If_None_Match=known, **headers)
            assert (status, nothing, again["etag"]) == (304, b"", tag)
            assert again["cache-control"] == plain["cache-control"]
        assert raw(server, path, If_None_Match='"x"', **headers)[0] == 200


@pytest.mark.parametrize(
    ("accepted", "is_packed"),
    [
        ("gzip", True),
        ("x-gzip, br", True),
        ("*", True),
        ("GZIP ; Q=0.5", True),
        ("gzip;q=0", False),
        ("*, gzip;q=0", False),
        ("br", False),
        ("gzip;q=none", False),
        ("", False),
    ],
)
def test_what_a_client_does_not_read_is_not_sent(server: Server, accepted: str, is_packed: bool) -> None:
    _, headers, _ = raw(server, "/dashboard/main.js", Accept_Encoding=accepted)
    assert ("content-encoding" in headers) is is_packed


async def test_long_answers_are_compressed_and_say_the_same(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_events(*(make_event(i, at=i, data={"v": i % 20}) for i in range(1, 201))))
        await monitor.acked(200)
        await monitor.detach()
    server.http.delete(f"/api/v1/sessions/{session}")
    for path in (
        f"sessions/{session}/verdicts?limit=200",
        f"sessions/{session}/violations?limit=200",
        f"sessions/{session}/timeline?buckets=500",
        f"sessions/{session}",
        "sessions",
        "specs",
    ):
        _, plain, body = raw(server, f"/api/v1/{path}")
        _, packed, shorter = raw(server, f"/api/v1/{path}", Accept_Encoding="gzip")
        assert "content-encoding" not in plain
        if len(body) < 1_400:
            assert "content-encoding" not in packed
            continue
        assert packed["content-encoding"] == "gzip", path
        assert (packed["content-type"], packed["vary"]) == ("application/json", "Accept-Encoding")
        assert json.loads(gzip.decompress(shorter)).keys() == json.loads(body).keys()
        assert len(shorter) < len(body) / 2
    _, headers, _ = raw(server, "/api/v1/sessions/none", Accept_Encoding="gzip")
    assert "content-encoding" not in headers


async def test_a_list_of_sessions_is_sent_again_only_where_it_has_changed(start: Starts) -> None:
    server = start(ORACLE_HISTORY="memory")
    path = "/api/v1/sessions?brief=true"
    async with attached(server, session="s", spec="single") as monitor:
        for coding in ("identity", "gzip"):
            status, headers, body = raw(server, path, Accept_Encoding=coding)
            assert status == 200
            assert body
            status, again, nothing = raw(server, path, Accept_Encoding=coding, If_None_Match=headers["etag"])
            assert (status, nothing, again["etag"]) == (304, b"", headers["etag"])
        await monitor.send(make_event(1, at=1, data={"v": 1}))
        await monitor.acked(1)
        status, headers, body = raw(server, path, If_None_Match=headers["etag"])
        assert status == 200
        assert json.loads(body)["items"][0]["steps"] == 1


async def test_nothing_is_kept_by_a_proxy_for_others(server: Server, session: str) -> None:
    """As by one that has a time of its own for answers which say nothing of it, and which asks nobody for a token."""
    async with attached(server, session=session, spec="single"):
        base = f"/api/v1/sessions/{session}"
        for path in ("/api/v1/sessions", "/api/v1/specs", base, f"{base}/trace", f"{base}none", "/readyz", "/metrics"):
            assert raw(server, path)[1]["cache-control"] == "private, no-cache"
        status, headers, _ = raw(server, "/api/v1/sessions", Host="robots.example")
        assert (status, headers["cache-control"]) == (421, "private, no-cache")
        with server.http.stream("GET", f"{base}/stream") as response:
            assert response.headers.get_list("cache-control") == ["no-store"]
