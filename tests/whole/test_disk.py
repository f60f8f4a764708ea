"""A history that can't be written for a while."""

from __future__ import annotations

import asyncio
import contextlib
import re
import signal
import sqlite3
from collections.abc import Iterator
from typing import BinaryIO

import httpx
import pytest
from oracle_adapter import Link, LinkError

from tests.whole.client import attached, connected, make_attach, make_clock, make_event, make_events, monitors, seqs
from tests.whole.conftest import Starts
from tests.whole.harness import PATIENCE, Server, failed, problem, run


@contextlib.contextmanager
def locked(server: Server) -> Iterator[None]:
    """Let nobody write to the database."""
    with contextlib.closing(sqlite3.connect(server.data / "history.sqlite", isolation_level=None)) as database:
        database.execute("BEGIN EXCLUSIVE")
        yield
        database.execute("ROLLBACK")


async def test_nothing_is_acked_or_lost_while_the_history_can_not_be_written(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="single") as monitor:
        with locked(server):
            await monitor.send(make_event(1, data={"v": 1}), make_event(2, at=1, data={"v": 1}))
            await server.until(lambda: server.http.get("/readyz").status_code, lambda status: status == 503)
            assert server.http.get("/healthz").status_code == 200
            assert monitor.upto == 0
            assert seqs(server, "s") == []
            for state in (server.get("sessions/s"), server.get("sessions", brief=True)["items"][0]):
                assert state["trouble"].startswith("nothing of it is judged while the history can't be written: ")
            assert "the history can't be written" in run("sessions", "--url", server.url).stdout
        await monitor.acked(2)
        await server.until(lambda: server.http.get("/readyz").status_code, lambda status: status == 200)
    assert seqs(server, "s") == [1, 2]
    assert server.get("sessions/s")["trouble"] is None


async def test_a_download_that_can_not_go_on_is_cut_off_and_told_in_a_line_of_the_log(start: Starts) -> None:
    server, last = start(), 1_500
    async with attached(server, session="s", spec="single") as monitor:
        await monitor.send(make_events(*(make_event(i, at=i, data={"v": 1}) for i in range(1, last + 1))))
        await monitor.acked(last)
    with contextlib.closing(sqlite3.connect(server.data / "history.sqlite", isolation_level=None)) as database:
        database.execute("ALTER TABLE steps RENAME TO away")
        names = [row[1] for row in database.execute("PRAGMA table_info(away)")]
        fails = f"CASE position WHEN {last} THEN abs(-{2**63}) ELSE outcomes END AS outcomes"  # on the second page
        taken = ", ".join(fails if name == "outcomes" else name for name in names)
        database.execute(f"CREATE VIEW steps AS SELECT {taken} FROM away")
        with pytest.raises(httpx.RemoteProtocolError, match="without sending complete message body"):
            server.http.get("/api/v1/sessions/s/trace")
        server.said(r"an answer was cut off: the history can't be read: .*integer overflow")
        database.execute("DROP VIEW steps")
        database.execute("ALTER TABLE away RENAME TO steps")
    server.check_log()
    assert len(server.http.get("/api/v1/sessions/s/trace").text.splitlines()) == last


async def test_a_download_that_can_not_begin_is_refused(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="single") as monitor:
        await monitor.send(make_event(1, data={"v": 1}))
        await monitor.acked(1)
    with contextlib.closing(sqlite3.connect(server.data / "history.sqlite", isolation_level=None)) as database:
        database.execute("ALTER TABLE steps RENAME TO away")
        told = problem(server.http.get("/api/v1/sessions/s/trace"), 503)
        database.execute("ALTER TABLE away RENAME TO steps")
    assert "no such table" in told["detail"]
    server.check_log()
    assert len(server.http.get("/api/v1/sessions/s/trace").text.splitlines()) == 1


async def test_a_session_can_not_be_closed_while_the_history_can_not_be_written(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="single") as monitor:
        with locked(server):
            await monitor.send(make_event(1, data={"v": 1}))
            await server.until(lambda: server.http.get("/readyz").status_code, lambda status: status == 503)
            deleting = [asyncio.to_thread(server.http.delete, "/api/v1/sessions/s") for _ in range(2)]
            for response in await asyncio.gather(*deleting):
                problem(response, 503)
        await server.until(lambda: server.get("sessions/s")["status"], lambda status: status == "closed")
        assert server.get("sessions/s")["trouble"] is None, "it is over, and so is that"
        frames, _ = await monitor.closed()
    assert {"type": "ack", "upto": 1} in frames
    assert seqs(server, "s") == [1]


async def test_a_session_is_told_to_be_open_once_it_is_kept(start: Starts) -> None:
    server = start()
    wanted = {"spec": "single", "id": "s"}
    with locked(server):
        body = problem(await asyncio.to_thread(server.http.post, "/api/v1/sessions", json=wanted), 503)
        assert "the history can't be written" in body["detail"]
        trace = server.http.get("/api/v1/sessions/s/trace")
        assert (trace.status_code, trace.text, seqs(server, "s")) == (200, "", [])
    problem(server.http.post("/api/v1/sessions", json=wanted), 409)
    assert server.http.post("/api/v1/sessions", json={**wanted, "id": "t"}).status_code == 201
    server.stop(signal.SIGKILL)
    server = start()
    assert {s["id"] for s in server.get("sessions")["items"]} == {"s", "t"}


def overwrite(file: BinaryIO, content: bytes) -> None:
    file.seek(0)
    file.write(content)
    file.flush()


async def test_a_history_that_is_locked_or_spoilt_is_told_in_words(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="single") as monitor:
        await monitor.send(*(make_event(i, at=i, data={"v": 1}) for i in range(1, 200)))
        await monitor.acked(199)
    assert server.stop() == 0
    with locked(server):
        message = failed("serve", "--data-dir", server.data, "--specs", server.specs, "--port", "0")
        assert "history.sqlite: can't be used as a database: database is locked" in message
    server = start(ORACLE_RESUME_WITHIN="3600")  # nothing is written while it is spoilt
    with (server.data / "history.sqlite").open("r+b") as file:  # in place: its length stays as it is
        sound = file.read()
        overwrite(file, sound[:4096] + bytes(len(sound) - 4096))
        body = problem(server.http.get("/api/v1/sessions/s/verdicts"), 503)
        assert re.search("malformed|disk I/O error", body["detail"])  # by what SQLite has in its memory
        overwrite(file, sound)
    assert len(server.records("s")) == 199


async def test_what_is_guarded_is_denied_while_the_history_can_not_be_written(start: Starts) -> None:
    server, request = start(), {"stream": "/switch", "kind": "request", "data": {"switch_on": False}}
    async with attached(server, session="s", spec="lamp", streams=["/switch"]) as monitor:
        await monitor.send(make_clock("/switch", 10**6, "response"))
        assert (await monitor.ask(1, **request))["decision"] == "allow"
        await monitor.acked(1)
        with locked(server):
            await monitor.send(make_event(2, "/switch", 1, {"switch_on": False}, kind="request"))
            await server.until(lambda: server.http.get("/readyz").status_code, lambda status: status == 503)
            denied = await monitor.ask(3, at=2, **request)
            assert denied["decision"] == "deny"
            assert denied["verdicts"]["only_in_the_dark"] == "unknown"
        await server.until(lambda: server.http.get("/readyz").status_code, lambda status: status == 200)
        assert (await monitor.ask(4, at=3, **request))["decision"] == "allow"
        await monitor.acked(4)


async def test_who_attaches_while_the_history_can_not_be_written_is_asked_to_come_again(start: Starts) -> None:
    """It waits for no disk, finds its place in the session kept, and an adapter does so by itself."""
    server = start()
    async with attached(server, session="s", spec="single") as monitor:
        await monitor.send(make_event(1, data={"v": 1}))
        await monitor.acked(1)
        monitor.vanish()
    await server.until(lambda: monitors(server, "s")["m1"], lambda m: not m["connected"])
    errors: list[LinkError] = []
    link = Link(server.url, "m3", spec="single", session="s", on_error=errors.append)
    with contextlib.closing(link):
        with locked(server):
            link.start()
            async with connected(server) as again, connected(server) as private:
                await again.send(make_attach("m1", session="s"))
                await private.send(make_attach("m2", spec="single"))
                for one in (again, private):
                    frames, code = await one.closed()
                    assert [(f["type"], f.get("code"), f.get("fatal")) for f in frames] == [
                        ("error", "history_unavailable", True)
                    ]
                    assert code == 1013
            await server.until(lambda: monitors(server, "s")["m1"], lambda m: m["attached"] and not m["connected"])
            await server.until(lambda: len(errors), bool)
        await asyncio.to_thread(link.wait_attached, PATIENCE)
        assert errors[0].code == "history_unavailable"
    async with attached(server, session="s") as monitor:
        assert monitor.attached["next"] == 2
        await monitor.send(make_event(2, at=2, data={"v": 1}))
        await monitor.acked(2)
    assert seqs(server, "s") == [1, 2]
