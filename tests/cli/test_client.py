"""What the command line reads of a running server, whatever a robot's texts hold."""

from __future__ import annotations

import contextlib
import json
import socket
import ssl
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import pytest
import trustme

from oracle_server.cli.client import Client, ServerUnreachableError
from tests.whole.client import attached, make_event
from tests.whole.conftest import copy_specs
from tests.whole.harness import Server, failed, run

ENDS = "a\u2028b\u2029c\x85d\x0be\x1cf"
"""Characters that Python takes for ends of lines, and neither JSON nor Server-Sent Events do."""
SPEC = "id: odd\nstreams:\n  - {topic: /a, signals: {v: msg.v}}\nproperties:\n  - {id: p, formula: 'not {v: *}'}\n"


async def test_texts_with_ends_of_lines_in_them_are_followed_and_recorded_whole(tmp_path: Path) -> None:
    with Server(copy_specs(tmp_path / "specs"), tmp_path / "data") as server:
        assert server.http.put("/api/v1/specs/odd", content=SPEC).is_success
        async with attached(server, session="s", spec="odd") as monitor:
            await monitor.send(make_event(1, data={"v": ENDS}), make_event(2, at=1, data={"v": "plain"}))
            await monitor.detach()
        assert server.http.delete("/api/v1/sessions/s").is_success
        followed = run("verdicts", "s", "--follow", "--json", "--url", server.url)
        assert (followed.returncode, followed.stderr) == (0, "")
        told = [json.loads(line) for line in followed.stdout.split("\n") if line]
        assert told == server.records("s")
        trace = tmp_path / "s.jsonl"
        assert run("record", "s", "--output", trace, "--url", server.url).returncode == 0
        lines = [json.loads(line) for line in trace.read_bytes().split(b"\n") if line]
        assert [line["signals"]["v"] for line in lines] == [ENDS, "plain"]


COMMANDS = [
    ("sessions",), ("specs",), ("top",), ("episodes",), ("verdicts", "s"), ("verdicts", "s", "--follow"),
    ("verdicts", "s", "--explain", "3"), ("close", "s"), ("record", "s", "-o"),
]  # fmt: skip


@contextmanager
def another(
    status: int, body: bytes, to: str | None = None, tls: ssl.SSLContext | None = None, lacks: int = 0
) -> Iterator[str]:
    """Another program that answers all in JSON, or sends on `to` another address, and its own address.

    It ends the connection so many bytes before an answer's end.
    """

    class Answer(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(status)
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Length", str(len(body) + lacks))
            if to is not None:
                self.send_header("Location", to)
            self.end_headers()
            self.wfile.write(body)

        do_DELETE = do_GET  # noqa: N815 -- the library's name

        def log_message(self, *_: object) -> None:
            pass

    class Listener(HTTPServer):
        def finish_request(self, request: Any, address: Any) -> None:
            with contextlib.suppress(OSError), tls.wrap_socket(request, True) if tls else request as connection:
                super().finish_request(connection, address)

    with Listener(("127.0.0.1", 0), Answer) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()
            thread.join()


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_another_program_at_the_address_is_told_as_one(command: tuple[str, ...], tmp_path: Path) -> None:
    files = [tmp_path / "s.jsonl"] if "-o" in command else []
    for status, body in ((200, b"{}"), (200, b'["items"]'), (404, b"[1]"), (500, b"<html>")):
        with another(status, body) as url:
            assert failed(*command, *files, "--url", url).endswith("as an oracle server"), (status, body)
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("url", ["localhost:8642", "[::1]:8642", "robot", "http//robot", "/run/oracle.sock", "unix:/x"])
def test_an_address_without_a_scheme_is_told_as_one(url: str) -> None:
    """It was told that a protocol localhost:// is not supported, and to start the server."""
    told = failed("sessions", "--url", url)
    assert f"--url or ORACLE_URL: '{url}' is no address of a server; write http://HOST:PORT, as " in told
    assert "oracle-server start" not in told


def reading(url: str) -> str:
    """Why a server can't be read."""
    with pytest.raises(ServerUnreachableError) as refused:
        Client(url).get("sessions")
    return str(refused.value)


def test_a_proxy_that_sends_on_is_told_as_one() -> None:
    """As from http:// to https://: it was said to be no oracle server."""
    with another(301, b"", "https://robots.example/oracle/api/v1/sessions?secret=1") as url:
        what = "which is not followed: name that server by --url or ORACLE_URL, if it is meant"
        assert reading(url) == f"{url}: answers 301 with https://robots.example/oracle, {what}"


def test_an_answer_that_is_cut_off_is_told_as_that() -> None:
    """As of a trace while the server ended: it was said to write https://."""
    with another(200, b"{}", lacks=1) as url:
        assert "; its answer was cut off, as where the server ended" in reading(url)


def test_what_to_do_is_said_of_tls_that_does_not_fit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was always to start the server, which runs."""
    authority, context = trustme.CA(), ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    authority.issue_cert("127.0.0.1").configure_cert(context)
    with another(200, b"{}", tls=context) as url:
        safe = url.replace("http:", "https:")
        assert reading(url).endswith("; where the server has TLS, write https://")
        monkeypatch.setattr("time.sleep", lambda _: pytest.fail("it is tried again, without a word"))
        with pytest.raises(ServerUnreachableError, match="where the server has TLS, write https://"):
            next(Client(url).events("sessions/s/stream", print))
        assert reading(safe).endswith("; ORACLE_CA names the file of the authority that signed it")
        authority.cert_pem.write_to_path(tmp_path / "ca.pem")
        monkeypatch.setenv("ORACLE_CA", str(tmp_path / "ca.pem"))
        assert reading(safe) == f"{safe}: answers, but not as an oracle server"
        assert reading(safe.replace("127.0.0.1", "localhost")).endswith(
            "; name the server as its certificate does, or renew that"
        )
    with another(200, b"{}") as url:
        assert reading(url.replace("http:", "https:")).endswith("; where the server has no TLS, write http://")


def test_a_server_that_stands_still_is_not_to_be_started() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent, pytest.raises(ServerUnreachableError) as refused:
        Client(f"http://127.0.0.1:{silent.getsockname()[1]}").get("sessions", within=0.1)
    assert str(refused.value).endswith("; it is busy, or stands still: try again, or look at its log")
