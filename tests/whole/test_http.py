"""The HTTP API: every route, every filter, every refusal."""

from __future__ import annotations

import asyncio
from contextlib import closing
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.whole.client import BASE, attached, make_clock, make_event
from tests.whole.conftest import Starts
from tests.whole.harness import PATIENCE, Server, problem

LAMP = (Path(__file__).parents[1] / "vectors" / "specs" / "lamp.yaml").read_text()
SPEC = """\
id: %s
streams:
  - topic: /a
properties:
  - id: p
    formula: 'not {topic: "/a", v: %s}'
"""


async def test_health(server: Server) -> None:
    assert server.http.get("/healthz").json() == {"status": "ok"}
    assert server.http.get("/readyz").json() == {"status": "ready"}


async def test_head_is_answered_as_get_without_the_body_and_a_stream_ends_behind_it(
    server: Server, session: str
) -> None:
    async with attached(server, session=session, spec="lamp"):
        base = f"/api/v1/sessions/{session}"
        with closing(HTTPConnection(server.http.base_url.host, server.http.base_url.port, timeout=PATIENCE)) as http:
            for path in ("/healthz", "/", base, f"{base}/stream", f"{base}/none", "/metrics", "/readyz"):
                with server.http.stream("GET", path) as got:
                    http.request("HEAD", path)  # over one connection, which each answer must leave free
                    answer = http.getresponse()
                    assert (answer.status, answer.getheader("content-type")) == (
                        got.status_code,
                        got.headers["content-type"],
                    )
                assert answer.read() == b""


async def test_a_download_is_refused_where_its_end_could_not_be_told(server: Server, session: str) -> None:
    """By HTTP/1.0, as nginx asks by default: one of which the server was killed was stored as a whole session."""
    async with attached(server, session=session, spec="lamp"):
        for what in ("trace", "changes"):
            path = f"/api/v1/sessions/{session}/{what}"
            reader, writer = await asyncio.open_connection(server.http.base_url.host, server.http.base_url.port)
            writer.write(f"GET {path} HTTP/1.0\r\nHost: localhost\r\n\r\n".encode())
            async with asyncio.timeout(PATIENCE):
                answer = await reader.read()
            writer.close()
            assert b" 505 " in answer.partition(b"\r\n")[0]
            assert b"proxy_http_version 1.1" in answer
            assert server.http.get(path).status_code == 200


def test_who_asks_for_no_websocket_is_told_what_a_proxy_must_pass_on(server: Server) -> None:
    answer = server.http.get("/api/v1/attach")
    assert (answer.status_code, answer.headers["upgrade"]) == (426, "websocket")
    assert "must pass on `Upgrade` and `Connection`" in answer.json()["detail"]


async def test_the_api_describes_itself(server: Server) -> None:
    assert server.http.get("/docs").status_code == 200
    document = server.http.get("/openapi.json").json()
    assert document["openapi"].startswith("3.")
    assert {
        "/api/v1/specs": {"get"},
        "/api/v1/specs/{spec_id}": {"get", "put"},
        "/api/v1/sessions": {"get", "post"},
        "/api/v1/sessions/{session_id}": {"get", "delete"},
        "/api/v1/sessions/{session_id}/verdicts": {"get"},
        "/api/v1/sessions/{session_id}/violations": {"get"},
    }.items() <= {path: set(methods) for path, methods in document["paths"].items()}.items()


async def test_specs_are_listed_and_told(server: Server) -> None:
    items = {s["id"]: s for s in server.get("specs")["items"]}
    assert {"lamp", "other", "pair", "single", "slow"} <= set(items)
    lamp = server.get("specs/lamp")
    assert lamp["text"] == LAMP
    threshold = {"signal": "/battery:percentage", "property": "battery_is_plausible", "op": ">", "value": 100}
    assert lamp == items["lamp"] | {"text": LAMP, "thresholds": [threshold]}
    assert lamp["description"] == "A lamp that is switched on in the dark only"
    assert lamp["source"] == "file"
    assert [(s["name"], s["kind"], s["action"]) for s in lamp["streams"]] == [
        ("/light", "topic", "log"),
        ("/battery", "topic", "log"),
        ("/switch", "request", "filter"),
        ("/switch", "response", "filter"),
    ]
    assert [p["id"] for p in lamp["properties"]] == ["only_in_the_dark", "battery_is_plausible"]


async def test_a_spec_is_put_used_and_replaced(server: Server, session: str) -> None:
    address = f"/api/v1/specs/put-{session}"
    first = server.http.put(address, content=SPEC % (f"put-{session}", 7))
    assert (first.status_code, first.json()["source"]) == (201, "put")
    async with attached(server, session=session, spec=f"put-{session}") as monitor:
        assert monitor.attached["spec_digest"] == first.json()["digest"]
        again = server.http.put(address, content=SPEC % (f"put-{session}", 7))
        assert (again.status_code, again.json()["digest"]) == (200, first.json()["digest"])
        other = server.http.put(address, content=SPEC % (f"put-{session}", 8))
        assert other.status_code == 200
        assert other.json()["digest"] != first.json()["digest"]
        assert server.http.get(address).json()["text"] == SPEC % (f"put-{session}", 8)
        await monitor.send(make_event(1, data={"v": 7}), make_event(2, at=1, data={"v": 8}))
        await monitor.acked(2)
    assert [r["outcome"] for r in server.records(session)] == ["currently_false", "currently_true"]
    assert f"put-{session}" in [s["id"] for s in server.get("specs")["items"]]


async def test_a_spec_that_is_put_comes_before_the_file(server: Server) -> None:
    text = server.get("specs/other")["text"]
    response = server.http.put("/api/v1/specs/other", content=text.replace("wrong: true", "wrong: false"))
    assert response.status_code == 200
    assert server.get("specs/other")["source"] == "put"


async def test_warnings_of_a_spec_are_told(server: Server) -> None:
    response = server.http.put("/api/v1/specs/lamp-warned", content=LAMP.replace("id: lamp\n", "id: lamp-warned\n"))
    assert response.status_code == 201
    types, warning = response.json()["warnings"]
    assert ":8:11: warning: the package example_msgs is not known here" in types
    assert ":18:20: warning: with `max_delay: none`" in warning


UNSOUND = {
    "no_yaml": ("id: [", 2, 1),
    "key": (SPEC % ("unsound", 7) + "colour: red\n", 7, 1),
    "formula": (SPEC % ("unsound", "*i"), 6, 19),
    "stream": (SPEC.replace('"/a", v', '"/b", v') % ("unsound", 7), 6, 19),
    "id": (SPEC % ("another", 7), 1, 1),
    "empty": ("", 1, 1),
}


@pytest.mark.parametrize(("text", "line", "column"), UNSOUND.values(), ids=UNSOUND)
async def test_an_unsound_spec_is_refused_with_its_place(server: Server, text: str, line: int, column: int) -> None:
    body = problem(server.http.put("/api/v1/specs/unsound", content=text), 422)
    assert (body["errors"][0]["line"], body["errors"][0]["column"]) == (line, column)
    assert body["errors"][0]["message"] in body["detail"]
    problem(server.http.get("/api/v1/specs/unsound"), 404)


async def test_a_refused_spec_leaves_the_one_before_it(server: Server) -> None:
    before = server.get("specs/strict")
    problem(server.http.put("/api/v1/specs/strict", content="id: strict\n"), 422)
    assert server.get("specs/strict") == before


async def test_a_body_that_is_too_long_or_no_text_is_refused(server: Server) -> None:
    comment = "# " + "x" * 2**20 + "\n"
    problem(server.http.put("/api/v1/specs/long", content=comment + SPEC % ("long", 7)), 413)
    problem(server.http.put("/api/v1/specs/long", content=iter([comment.encode()] * 3)), 413)
    problem(server.http.put("/api/v1/specs/long", content=b"id: \xff\xfe"), 422)
    problem(server.http.get("/api/v1/specs/long"), 404)


@pytest.mark.parametrize("spec_id", ["a%20b", "x" * 65, "a%2Fb", "%C3%A4", "a%0A"])
async def test_an_id_that_can_be_none_is_refused(server: Server, spec_id: str) -> None:
    response = server.http.put(f"/api/v1/specs/{spec_id}", content=SPEC % ("x", 7))
    problem(response, response.status_code)
    assert response.status_code in (404, 422)


async def test_a_session_is_opened_told_closed_and_kept(server: Server, session: str) -> None:
    response = server.http.post("/api/v1/sessions", json={"spec": "pair", "id": session})
    assert response.status_code == 201
    opened = response.json()
    assert (opened["id"], opened["spec"], opened["status"], opened["monitors"]) == (session, "pair", "open", [])
    assert server.get(f"sessions/{session}") == opened
    assert session in [s["id"] for s in server.get("sessions")["items"]]
    async with attached(server, session=session, streams=["/a", "/b"]) as monitor:
        await monitor.send(make_event(1, "/a", at=10, data={"v": 11}), make_event(2, "/b", at=20, data={"id": 1}))
        await monitor.send(make_clock("/a", 15))
        await monitor.violated(1)
        state = server.get(f"sessions/{session}")
        streams = {s["stream"]: s for s in state["streams"]}
        assert {name: (s["monitor"], s["kind"], s["frontier"] - BASE, s["depth"]) for name, s in streams.items()} == {
            "/a": ("m1", "topic", 15 * 10**6, 0),
            "/b": ("m1", "topic", 20 * 10**6, 1),
        }
        assert streams["/a"]["lag"] - streams["/b"]["lag"] == 5 * 10**6
        states = {p["id"]: p for p in state["properties"]}
        assert (states["a_is_small"]["outcome"], states["a_is_small"]["first_violation"]) == ("currently_false", 2)
        assert (states["b_after_a"]["outcome"], states["b_after_a"]["first_violation"]) == ("currently_true", None)
        assert (state["counters"]["steps"], state["counters"]["held"]) == (1, 1)
        closed = server.http.delete(f"/api/v1/sessions/{session}").json()
    assert (closed["status"], closed["counters"]["steps"], closed["counters"]["held"]) == ("closed", 2, 0)
    assert closed["closed"] >= closed["opened"]
    assert server.get(f"sessions/{session}") == closed
    assert server.http.delete(f"/api/v1/sessions/{session}").json() == closed
    assert len(server.records(session)) == 2 * len(states)
    problem(server.http.post("/api/v1/sessions", json={"spec": "pair", "id": session}), 409)


async def test_a_session_that_is_opened_without_a_name_gets_one(server: Server) -> None:
    first, second = (server.http.post("/api/v1/sessions", json={"spec": "single"}).json()["id"] for _ in range(2))
    assert first != second
    async with attached(server, session=first) as monitor:
        await monitor.detach()
    assert server.get(f"sessions/{first}")["status"] == "open"


async def test_a_session_can_not_be_opened_twice_or_of_nothing(server: Server, session: str) -> None:
    assert server.http.post("/api/v1/sessions", json={"spec": "single", "id": session}).status_code == 201
    problem(server.http.post("/api/v1/sessions", json={"spec": "single", "id": session}), 409)
    problem(server.http.post("/api/v1/sessions", json={"spec": "nowhere"}), 404)
    bodies: list[Any] = [
        {},
        {"spec": 7},
        {"spec": "single", "id": "a b"},
        {"spec": "single", "colour": "red"},
        [],
        None,
    ]
    for body in bodies:
        problem(server.http.post("/api/v1/sessions", json=body), 422)
    problem(server.http.post("/api/v1/sessions", content=b"{"), 422)
    problem(server.http.post("/api/v1/sessions", content=b"\xff"), 422)


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/nowhere", 404),
        ("GET", "/api/v1/nowhere", 404),
        ("GET", "/api/v1/specs/nowhere", 404),
        ("GET", "/api/v1/sessions/nowhere", 404),
        ("DELETE", "/api/v1/sessions/nowhere", 404),
        ("GET", "/api/v1/sessions/nowhere/verdicts", 404),
        ("GET", "/api/v1/sessions/nowhere/violations", 404),
        ("POST", "/healthz", 405),
        ("DELETE", "/api/v1/specs", 405),
        ("DELETE", "/api/v1/specs/lamp", 405),
        ("PUT", "/api/v1/sessions", 405),
        ("POST", "/api/v1/sessions/x/verdicts", 405),
    ],
)
async def test_what_is_not_there_is_a_problem(server: Server, method: str, path: str, status: int) -> None:
    response = server.http.request(method, path)
    problem(response, status)
    if status == 405:
        assert response.headers["allow"]


@pytest.mark.parametrize("method", ["PATCH", "OPTIONS"])
@pytest.mark.parametrize(
    ("path", "methods"),
    [
        ("/healthz", "GET, HEAD"),
        ("/api/v1/specs/lamp", "GET, HEAD, PUT"),
        ("/api/v1/specs/lamp/check", "POST"),
        ("/api/v1/sessions", "GET, HEAD, POST"),
        ("/api/v1/sessions/x", "DELETE, GET, HEAD"),
    ],
)
async def test_all_methods_that_there_are_are_told(server: Server, method: str, path: str, methods: str) -> None:
    response = server.http.request(method, path)
    problem(response, 405)
    assert response.headers["allow"] == methods


async def test_what_is_no_http_is_a_problem_too(server: Server) -> None:
    host, port = server.url.removeprefix("http://").split(":")
    reader, writer = await asyncio.open_connection(host, int(port))
    writer.write(b"HELO example.org\r\n\r\n")
    async with asyncio.timeout(PATIENCE):
        answer = await reader.read()
    writer.close()
    await writer.wait_closed()
    assert answer.startswith(b"HTTP/1.1 400 ")
    assert b"application/problem+json" in answer


async def test_one_spec_put_many_times_at_once_is_put_each_time(start: Starts) -> None:
    server = start()
    async with httpx.AsyncClient(base_url=server.url, timeout=PATIENCE, trust_env=False) as http:
        texts = [SPEC % ("busy", v) for v in range(40)]
        responses = await asyncio.gather(*(http.put("/api/v1/specs/busy", content=text) for text in texts))
    assert {r.status_code for r in responses} <= {200, 201}
    assert server.get("specs/busy")["text"] in texts


async def test_one_name_asked_for_many_times_at_once_is_one_session(server: Server, session: str) -> None:
    async with httpx.AsyncClient(base_url=server.url, timeout=PATIENCE, trust_env=False) as http:
        wanted = {"spec": "pair", "id": session}
        responses = await asyncio.gather(*(http.post("/api/v1/sessions", json=wanted) for _ in range(10)))
    assert sorted(r.status_code for r in responses) == [201] + [409] * 9


async def test_a_spec_file_that_has_become_unsound_hides_no_other(start: Starts) -> None:
    server = start()
    (server.specs / "single.yaml").write_text("id: single\n")
    assert {"lamp", "pair"} <= {s["id"] for s in server.get("specs")["items"]}
    body = problem(server.http.get("/api/v1/specs/single"), 422)
    assert "single.yaml:1:1" in body["detail"]
    body = problem(server.http.post("/api/v1/sessions", json={"spec": "single"}), 422)
    assert "single.yaml:1:1" in body["detail"]


def test_a_slash_too_many_leads_to_the_same_path_behind_a_proxy_that_puts_one_before_it(server: Server) -> None:
    for path in ("/api/v1/sessions/?brief=true", "/docs/", "/api/v1/specs/"):
        answer = server.http.get(path)
        assert answer.status_code == 307
        assert answer.next_request is not None
        there = path.split("?")[0].rstrip("/")
        assert answer.next_request.url.path == there
        assert answer.next_request.url.query == answer.request.url.query
        target = f"http://robots.example/oracle{path}"
        assert str(httpx.URL(target).join(answer.headers["location"])) == target.replace("/?", "?").rstrip("/")
        assert server.http.get(path, follow_redirects=True).status_code == 200
    problem(server.http.get("/api/v1/nowhere/"), 404)
