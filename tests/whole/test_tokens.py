"""Tokens: each test tries what must not be possible, and what must."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Iterator
from contextlib import suppress
from pathlib import Path

import httpx
import pytest
from oracle_adapter import Link
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus

from oracle_server.edge.tokens import add, hash_of
from tests.whole.client import make_attach, make_event
from tests.whole.conftest import Starts
from tests.whole.harness import PATIENCE, Server, failed, problem, run

SPEC = "id: fresh\nstreams:\n  - topic: /a\nproperties:\n  - {id: p, formula: '{v: 1}'}\n"


class Guarded:
    """A server that wants tokens, and the tokens."""

    def __init__(self, start: Starts, data: Path) -> None:
        file = data / "tokens.json"
        self.secrets = {
            "submit": add(file, "submit", ["submit"]),
            "read": add(file, "read", ["read"]),
            "admin": add(file, "admin", ["admin"]),
            "bound": add(file, "bound", ["admin"], specs=["single"]),
            "joined": add(file, "joined", ["submit", "read"], sessions=["ours"]),
        }
        self.server: Server = start()

    def ask(self, who: str | None, method: str, path: str, **more: object) -> httpx.Response:
        headers = {"Authorization": f"Bearer {self.secrets[who]}"} if who else {}
        return self.server.http.request(method, path, headers=headers, **more)  # type: ignore[arg-type]

    async def attach(self, who: str | None, **fields: object) -> dict[str, object]:
        """The answer to an attempt to attach; raises where the handshake is refused."""
        headers = {"Authorization": f"Bearer {self.secrets[who]}"} if who else {}
        url = self.server.url.replace("http", "ws", 1) + "/api/v1/attach"
        async with (
            asyncio.timeout(PATIENCE),
            connect(url, additional_headers=headers, proxy=None, open_timeout=PATIENCE) as socket,
        ):
            await socket.send(json.dumps(make_attach(**fields)))  # type: ignore[arg-type]
            answer: dict[str, object] = json.loads(await socket.recv())
            return answer


@pytest.fixture
def guarded(start: Starts, tmp_path: Path) -> Iterator[Guarded]:
    (tmp_path / "data").mkdir()
    guarded = Guarded(start, tmp_path / "data")
    yield guarded
    assert not any(secret in guarded.server.log for secret in guarded.secrets.values())


READING = ["/api/v1/specs", "/api/v1/sessions", "/api/v1/sessions/s/verdicts", "/metrics"]


async def test_without_a_good_token_nothing_is_told_or_done(guarded: Guarded) -> None:
    server = guarded.server
    offers: list[dict[str, str]] = [
        {},
        {"Authorization": "Bearer"},
        {"Authorization": "Bearer oracle_wrong"},
        {"Authorization": "Bearer " + hash_of(guarded.secrets["admin"])},
        {"Authorization": "Basic " + guarded.secrets["admin"]},
        {"Authorization": guarded.secrets["admin"]},
        {"Authorization": "Bearer " + guarded.secrets["admin"].upper()},
        {"Authorization": "Bearer " + guarded.secrets["admin"][:-1]},
        {"Cookie": "token=" + guarded.secrets["admin"]},
    ]
    for headers in offers:
        for path in READING:
            response = server.http.get(path, headers=headers)
            sent = headers.get("Authorization", "").startswith("Bearer ")
            told = "the token that was sent is not known here" if sent else "a token is needed"
            assert problem(response, 401)["detail"].startswith(told)
            assert response.headers["www-authenticate"] == "Bearer"
        problem(server.http.put("/api/v1/specs/fresh", content=SPEC, headers=headers), 401)
        problem(server.http.post("/api/v1/sessions", json={"spec": "single"}, headers=headers), 401)
        problem(server.http.delete("/api/v1/sessions/s", headers=headers), 401)
    two = [("Authorization", "Bearer x"), ("Authorization", f"Bearer {guarded.secrets['admin']}")]
    problem(server.http.get("/api/v1/sessions", headers=two), 401)
    with pytest.raises(InvalidStatus, match="401"):
        await guarded.attach(None, spec="single")
    assert guarded.ask("admin", "GET", "/api/v1/sessions").json() == {"items": []}


def test_a_token_in_the_address_is_no_token(guarded: Guarded) -> None:
    for name in ("token", "access_token", "authorization"):
        problem(guarded.server.http.get("/api/v1/sessions", params={name: guarded.secrets["admin"]}), 401)


def test_what_says_nothing_of_robots_needs_no_token(guarded: Guarded) -> None:
    for path in ("/healthz", "/readyz", "/docs", "/openapi.json"):
        assert guarded.ask(None, "GET", path).status_code == 200


async def test_a_token_of_a_file_is_one_with_the_newline_at_its_end(guarded: Guarded) -> None:
    server, secret = guarded.server, guarded.secrets["admin"]
    for token in (f"{secret}\n", f" {secret}\r\n"):
        told = run("sessions", "--url", server.url, ORACLE_TOKEN=token)
        assert (told.returncode, told.stderr) == (0, "")
        with Link(server.url, "m1", spec="single", session="s", token=token) as link:
            assert (await asyncio.to_thread(link.wait_attached, PATIENCE)).session == "s"
    broken = f"{secret[:9]}\n{secret[9:]}"
    told_of = failed("sessions", "--url", server.url, ORACLE_TOKEN=broken)
    with pytest.raises(ValueError, match="the token is none") as refused:
        Link(server.url, "m1", spec="single", token=broken)
    assert not any(secret[9:] in text for text in (told_of, str(refused.value)))


async def test_a_refused_monitor_is_logged_as_one(guarded: Guarded) -> None:
    with pytest.raises(InvalidStatus, match="401"):
        await guarded.attach(None, spec="single")
    guarded.server.said(r"\[warning *\] a WebSocket was refused; the answer told its client why")
    assert "ASGI" not in guarded.server.log


async def test_scopes_hold(guarded: Guarded) -> None:
    for path in READING[:2]:
        assert guarded.ask("read", "GET", path).status_code == 200
        problem(guarded.ask("submit", "GET", path), 403)
    for who in ("read", "submit"):
        problem(guarded.ask(who, "PUT", "/api/v1/specs/fresh", content=SPEC), 403)
        problem(guarded.ask(who, "DELETE", "/api/v1/sessions/s"), 403)
    problem(guarded.ask("read", "POST", "/api/v1/sessions", json={"spec": "single"}), 403)
    with pytest.raises(InvalidStatus, match="403"):
        await guarded.attach("read", spec="single")
    assert guarded.ask("admin", "PUT", "/api/v1/specs/fresh", content=SPEC).status_code == 201
    assert guarded.ask("submit", "POST", "/api/v1/sessions", json={"spec": "single"}).status_code == 201
    assert (await guarded.attach("submit", spec="single"))["type"] == "attached"


async def test_a_token_is_held_to_its_specs_and_sessions(guarded: Guarded) -> None:
    for session, spec in (("ours", "single"), ("theirs", "pair")):
        assert guarded.ask("admin", "POST", "/api/v1/sessions", json={"spec": spec, "id": session}).status_code == 201
    for path in ("", "/verdicts", "/violations", "/stream", "/trace"):
        problem(guarded.ask("bound", "GET", f"/api/v1/sessions/theirs{path}"), 403)
        problem(guarded.ask("joined", "GET", f"/api/v1/sessions/theirs{path}"), 403)
    problem(guarded.ask("bound", "DELETE", "/api/v1/sessions/theirs"), 403)
    problem(guarded.ask("bound", "POST", "/api/v1/sessions", json={"spec": "pair"}), 403)
    problem(guarded.ask("joined", "POST", "/api/v1/sessions", json={"spec": "pair", "id": "other"}), 403)
    problem(guarded.ask("bound", "PUT", "/api/v1/specs/fresh", content=SPEC), 403)
    problem(guarded.ask("bound", "GET", "/api/v1/specs/pair"), 403)
    assert [s["id"] for s in guarded.ask("bound", "GET", "/api/v1/specs").json()["items"]] == ["single"]
    for who in ("bound", "joined"):
        assert [s["id"] for s in guarded.ask(who, "GET", "/api/v1/sessions").json()["items"]] == ["ours"]
        assert guarded.ask(who, "GET", "/api/v1/sessions/ours/verdicts").status_code == 200
    attempts: list[tuple[str, dict[str, str]]] = [
        ("bound", {"session": "theirs"}),
        ("bound", {"session": "theirs", "spec": "single"}),
        ("bound", {"spec": "pair"}),
        ("joined", {"session": "theirs"}),
        ("joined", {"spec": "single"}),
        ("joined", {"session": "new", "spec": "single"}),
    ]
    for who, wanted in attempts:
        answer = await guarded.attach(who, **wanted)
        assert (answer["type"], answer.get("code")) == ("error", "forbidden"), (who, wanted)
    assert (await guarded.attach("bound", session="ours"))["type"] == "attached"
    assert (await guarded.attach("joined", monitor="m2", session="ours"))["type"] == "attached"


async def test_a_bound_token_changes_nothing_of_all_and_is_told_nothing_of_others(guarded: Guarded) -> None:
    file = guarded.server.data / "tokens.json"
    guarded.secrets |= {
        "chief": add(file, "chief", ["admin"], sessions=["ours"]),
        "narrow": add(file, "narrow", ["admin"], specs=["pair"], sessions=["ours"]),
    }
    for session, spec in (("ours", "single"), ("theirs", "pair")):
        assert guarded.ask("admin", "POST", "/api/v1/sessions", json={"spec": spec, "id": session}).status_code == 201
    spec = guarded.ask("admin", "GET", "/api/v1/specs/single").json()["text"]
    for who in ("chief", "narrow"):
        for name, text in (("single", spec), ("fresh", SPEC)):
            problem(guarded.ask(who, "PUT", f"/api/v1/specs/{name}", content=text), 403)
    for who in ("chief", "joined"):
        assert [s["id"] for s in guarded.ask(who, "GET", "/api/v1/specs").json()["items"]] == ["single"]
        assert guarded.ask(who, "GET", "/api/v1/specs/single").status_code == 200
        details = [problem(guarded.ask(who, "GET", f"/api/v1/specs/{n}"), 403)["detail"] for n in ("pair", "nowhere")]
        assert details[0] == details[1]
    assert guarded.ask("narrow", "GET", "/api/v1/specs").json()["items"] == []
    for who in ("chief", "joined", "bound", "narrow"):
        assert "bound" in problem(guarded.ask(who, "GET", "/metrics"), 403)["detail"]
    assert guarded.ask("read", "GET", "/metrics").status_code == 200
    assert guarded.ask("admin", "DELETE", "/api/v1/sessions/ours").status_code == 200
    assert [s["id"] for s in guarded.ask("chief", "GET", "/api/v1/specs").json()["items"]] == ["single"]


async def test_a_bound_token_is_not_told_which_sessions_and_specs_there_are(guarded: Guarded) -> None:
    for session in ("open", "closed"):
        assert guarded.ask("admin", "POST", "/api/v1/sessions", json={"spec": "pair", "id": session}).status_code == 201
    assert guarded.ask("admin", "DELETE", "/api/v1/sessions/closed").status_code == 200
    for who in ("bound", "joined"):
        for method, path in (("GET", ""), ("GET", "/verdicts"), ("GET", "/stream"), ("GET", "/trace"), ("DELETE", "")):
            asked = [guarded.ask(who, method, f"/api/v1/sessions/{s}{path}") for s in ("open", "closed", "nowhere")]
            assert len({(answer.status_code, answer.text) for answer in asked}) == 1
            problem(asked[0], 403)
    for session in ("open", "closed"):
        problem(guarded.ask("bound", "POST", "/api/v1/sessions", json={"spec": "single", "id": session}), 403)
        for who in ("bound", "joined"):
            answer = await guarded.attach(who, session=session, spec="single")
            assert (answer["type"], answer["code"]) == ("error", "forbidden")
    answer = await guarded.attach("joined", session="ours", spec="nowhere")
    assert (answer["code"], answer["message"]) == ("unknown_spec", "there is no spec 'nowhere'")
    made = guarded.ask("joined", "POST", "/api/v1/sessions", json={"spec": "nowhere", "id": "ours"})
    assert problem(made, 404)["detail"] == "there is no spec 'nowhere'"
    assert "known are" in str((await guarded.attach("submit", session="ours", spec="nowhere"))["message"])


async def test_a_token_goes_on_in_the_session_that_follows_its_own(guarded: Guarded) -> None:
    guarded.secrets["robot"] = add(guarded.server.data / "tokens.json", "robot", ["submit"], sessions=["s1"])
    answer = await guarded.attach("robot", session="s1.run2", spec="single")
    assert answer["type"] == "attached"
    answer = await guarded.attach("robot", session="s2.run2", spec="single")
    assert answer["code"] == "forbidden"


def test_the_file_must_be_nobody_elses(tmp_path: Path) -> None:
    data = tmp_path / "data"
    assert run("token", "add", "a", "--scope", "read", "--data-dir", data).returncode == 0
    file = data / "tokens.json"
    assert file.stat().st_mode & 0o777 == 0o600
    for mode in (0o640, 0o604, 0o620):
        file.chmod(mode)
        for command in (["serve", "--port", "0"], ["token", "list"], ["token", "add", "b", "--scope", "read"]):
            assert "chmod 600" in failed(*command, "--data-dir", data)


def test_the_file_holds_no_token(tmp_path: Path) -> None:
    secret = run("token", "add", "a", "--scope", "read", "--scope", "submit", "--data-dir", tmp_path).stdout.strip()
    text = (tmp_path / "tokens.json").read_text()
    assert secret not in text
    assert hash_of(secret) in text
    assert secret not in run("token", "list", "--data-dir", tmp_path).stdout
    assert "already" in failed("token", "add", "a", "--scope", "read", "--data-dir", tmp_path)
    assert "no token 'b'" in failed("token", "remove", "b", "--data-dir", tmp_path)


def test_where_no_server_knows_of_a_token_is_told(tmp_path: Path) -> None:
    """Whoever adds it to the wrong folder would think that the server, which runs with another, asks for it."""
    added = run("token", "add", "a", "--scope", "read", "--data-dir", tmp_path)
    assert added.returncode == 0
    assert added.stdout.count("\n") == 1
    assert added.stderr.startswith(f"oracle-server: kept in {tmp_path / 'tokens.json'}, for a server with this data ")


def test_a_file_of_tokens_that_is_not_there_is_told(tmp_path: Path) -> None:
    """A server behind a proxy, whose file of tokens is misspelt or not mounted, lets everybody in."""
    refused = ("serve", "--data-dir", tmp_path, "--host", "192.0.2.1")
    said = [run(*refused, **given).stderr for given in ({}, {"ORACLE_TOKENS": str(tmp_path / "tokns.json")})]
    assert ["no token is asked for: the file that ORACLE_TOKENS names is not there" in text for text in said] == [
        False,
        True,
    ]


def test_tokens_come_and_go_while_the_server_runs(guarded: Guarded) -> None:
    data = guarded.server.data
    added = run("token", "add", "late", "--scope", "read", "--data-dir", data)
    assert added.stderr == ""
    guarded.secrets["late"] = added.stdout.strip()
    assert guarded.ask("late", "GET", "/api/v1/sessions").status_code == 200
    assert run("token", "remove", "late", "--data-dir", data).returncode == 0
    problem(guarded.ask("late", "GET", "/api/v1/sessions"), 401)


async def until_the_end(chunks: AsyncIterator[bytes]) -> None:
    async for _ in chunks:
        pass


async def test_what_a_token_has_opened_ends_with_it(guarded: Guarded) -> None:
    data, url = guarded.server.data, guarded.server.url
    for name, scope in (("robot", "submit"), ("old", "submit"), ("viewer", "read")):
        secret = run("token", "add", name, "--scope", scope, "--data-dir", data).stdout.strip()
        guarded.secrets[name] = secret
    socket_url = url.replace("http", "ws", 1)

    def headers(who: str) -> dict[str, str]:
        return {"Authorization": f"Bearer {guarded.secrets[who]}"}

    def opened(who: str, path: str) -> connect:
        return connect(f"{socket_url}{path}", additional_headers=headers(who), proxy=None, open_timeout=PATIENCE)

    async with (
        asyncio.timeout(PATIENCE),
        opened("robot", "/api/v1/attach") as robot,
        opened("submit", "/api/v1/attach") as other,
        opened("old", "/legacy/single") as old,
        httpx.AsyncClient(base_url=url, trust_env=False, timeout=PATIENCE) as http,
    ):
        for number, socket in enumerate((robot, other)):
            await socket.send(json.dumps(make_attach(f"m{number}", session="s", spec="single")))
            assert json.loads(await socket.recv())["type"] == "attached"
        async with http.stream("GET", "/api/v1/sessions/s/stream", headers=headers("viewer")) as stream:
            chunks = stream.aiter_raw()
            assert b"verdicts of a session" in await anext(chunks)
            for name in ("robot", "old", "viewer"):
                removed = await asyncio.to_thread(run, "token", "remove", name, "--data-dir", data)
                assert removed.returncode == 0
            with pytest.raises(httpx.RemoteProtocolError):
                await until_the_end(chunks)
        for ended in (robot, old):
            await ended.wait_closed()
            assert ended.close_code == 1008
        await other.send(json.dumps(make_event(1, data={"v": 1}, ask=True)))
        while json.loads(await other.recv())["type"] != "decision":
            pass
    assert guarded.ask("read", "GET", "/api/v1/sessions/s").json()["counters"]["steps"] == 1
    guarded.server.said(r"their token was removed or changed\s+count=")


async def test_a_trace_that_is_being_read_ends_with_its_token(guarded: Guarded) -> None:
    data = guarded.server.data
    guarded.secrets["viewer"] = run("token", "add", "viewer", "--scope", "read", "--data-dir", data).stdout.strip()
    url = guarded.server.url.replace("http", "ws", 1) + "/api/v1/attach"
    headers = {"Authorization": f"Bearer {guarded.secrets['submit']}"}
    count, filling = 600, "x" * 40_000
    async with connect(url, additional_headers=headers, proxy=None, open_timeout=PATIENCE) as socket:
        await socket.send(json.dumps(make_attach(session="long", spec="texts")))
        for seq in range(1, count + 1):
            await socket.send(json.dumps(make_event(seq, at=seq, data={"name": filling, "list": []})))
        upto = 0
        async with asyncio.timeout(PATIENCE):
            while upto < count:
                frame = json.loads(await socket.recv())
                upto = frame["upto"] if frame["type"] == "ack" else upto
    port = int(guarded.server.url.rpartition(":")[2])
    reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1024)
    writer.write(
        f"GET /api/v1/sessions/long/trace HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n"
        f"Authorization: Bearer {guarded.secrets['viewer']}\r\n\r\n".encode()
    )
    async with asyncio.timeout(PATIENCE):
        assert (await reader.readline()).endswith(b"200 OK\r\n")
        assert run("token", "remove", "viewer", "--data-dir", data).returncode == 0
        await asyncio.to_thread(guarded.server.said, "their token was removed")
        rest = b""
        with suppress(ConnectionError):
            while chunk := await reader.read(2**20):
                rest += chunk
    writer.close()
    assert len(rest) < count * len(filling) / 2


def test_the_command_line_uses_a_token(guarded: Guarded) -> None:
    url = guarded.server.url
    assert "token" in failed("sessions", "--url", url)
    assert run("sessions", "--url", url, ORACLE_TOKEN=guarded.secrets["read"]).returncode == 0
    assert "lacks the scope" in failed("sessions", "--url", url, ORACLE_TOKEN=guarded.secrets["submit"])


async def test_events_before_the_answer_of_a_refused_handshake_are_not_read(guarded: Guarded) -> None:
    port = int(guarded.server.url.rpartition(":")[2])
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    handshake = (
        f"GET /api/v1/attach HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    )
    text = json.dumps(make_attach(session="s", spec="single")).encode()
    frame = bytes((0x81, 0x80 | len(text))) + bytes(4) + text
    event = json.dumps(make_event(1, data={"v": 1})).encode()
    frame += bytes((0x81, 0x80 | len(event))) + bytes(4) + event
    assert max(len(text), len(event)) < 126
    writer.write(handshake.encode() + frame)
    async with asyncio.timeout(PATIENCE):
        answer = await reader.read()
    writer.close()
    assert answer.startswith(b"HTTP/1.1 401 ")
    problem(guarded.ask("admin", "GET", "/api/v1/sessions/s"), 404)


async def test_a_token_s_bounds_hold_for_old_monitors_and_for_traces(guarded: Guarded) -> None:
    assert guarded.ask("admin", "PUT", "/api/v1/specs/fresh", content=SPEC).status_code == 201
    made = guarded.ask("admin", "POST", "/api/v1/sessions", json={"spec": "fresh", "id": "theirs"})
    assert made.status_code == 201
    assert guarded.ask("bound", "GET", "/api/v1/sessions/theirs/trace").status_code == 403
    assert guarded.ask("read", "GET", "/api/v1/sessions/theirs/trace").status_code == 200
    url = guarded.server.url.replace("http", "ws", 1)
    headers = {"Authorization": f"Bearer {guarded.secrets['bound']}"}
    with pytest.raises(InvalidStatus, match="403"):
        async with connect(f"{url}/legacy/fresh", additional_headers=headers, proxy=None, open_timeout=PATIENCE):
            pass
    async with connect(f"{url}/legacy/single", additional_headers=headers, proxy=None, open_timeout=PATIENCE):
        pass
