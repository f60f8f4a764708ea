"""Verdicts as Server-Sent Events: all of them, each once, over as many connections as it takes."""

from __future__ import annotations

import asyncio
import json
import socket
import subprocess
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.whole.client import attached, make_event, make_events
from tests.whole.conftest import Starts
from tests.whole.harness import COMMAND, PATIENCE, Server, environment, problem

Event = dict[str, str]


@asynccontextmanager
async def stream(
    server: Server, session: str, path: str = "stream", last: int | None = None, **query: Any
) -> AsyncIterator[AsyncIterator[Event]]:
    headers = {} if last is None else {"Last-Event-ID": str(last)}
    async with (
        httpx.AsyncClient(base_url=server.url, timeout=PATIENCE, trust_env=False) as http,
        http.stream("GET", f"/api/v1/sessions/{session}/{path}", params=query, headers=headers) as response,
    ):
        assert response.status_code == 200
        assert response.headers["content-type"].split(";")[0] == "text/event-stream"
        assert response.headers["cache-control"] == "no-store", "no proxy answers with what was"
        assert response.headers["x-accel-buffering"] == "no", "nor keeps what comes"
        yield parsed(response.aiter_lines())


async def parsed(lines: AsyncIterator[str]) -> AsyncIterator[Event]:
    event: Event = {}
    async for line in lines:
        name, _, value = line.partition(": ")
        if line and name:
            event[name] = value
        elif event:
            yield event
            event = {}


async def take(events: AsyncIterator[Event], count: int) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = []
    async with asyncio.timeout(PATIENCE):
        while len(found) < count:
            event = await anext(events)
            found.append(json.loads(event["data"]))
            assert event["id"] == str(found[-1]["n"])
    return found


def numbered(first: int, last: int) -> list[dict[str, Any]]:
    return [make_event(i, at=i, data={"v": i % 3}) for i in range(first, last + 1)]


async def test_what_was_and_what_comes_is_told_in_order(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_events(*numbered(1, 1200)))
        await monitor.acked(1200)
        async with stream(server, session) as events:
            told = await take(events, 1200)
            await monitor.send(*numbered(1201, 1210))
            told += await take(events, 10)
            await monitor.detach()
            assert server.http.delete(f"/api/v1/sessions/{session}").status_code == 200
            async with asyncio.timeout(PATIENCE):
                rest = [event async for event in events]
    assert told == server.records(session)
    assert [event["event"] for event in rest] == ["closed"]


async def test_a_stream_goes_on_after_the_last_that_was_read(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(*numbered(1, 20))
        await monitor.acked(20)
        for last in (0, 1, 7, 19):
            async with stream(server, session, last=last) as events:
                assert [r["n"] for r in await take(events, 20 - last)] == list(range(last + 1, 21))
            async with stream(server, session, after=last) as events:
                assert (await take(events, 1))[0]["n"] == last + 1


async def test_only_what_is_asked_for_is_told(server: Server, session: str) -> None:
    async with (
        attached(server, session=session, spec="pair", streams=["/a", "/b"]) as monitor,
        stream(server, session, property="a_is_small") as one,
        stream(server, session, violations="true") as violations,
        stream(server, session, outcome="currently_false", stream="/a") as negative,
    ):
        events = [make_event(i, "/a", at=i, data={"v": 1 + 999 * (i % 4 == 0)}) for i in range(1, 41)]
        await monitor.send(*events)
        await monitor.detach()
        assert server.http.delete(f"/api/v1/sessions/{session}").status_code == 200
        told = []
        for stream_ in (one, violations, negative):
            async with asyncio.timeout(PATIENCE):
                told.append([json.loads(event["data"]) async for event in stream_ if "id" in event])
    assert told[0] == server.records(session, property="a_is_small")
    assert told[1] == server.records(session, "violations")
    assert told[2] == server.records(session, outcome="currently_false", stream="/a")
    assert told[0]


async def test_a_stream_of_nothing_is_a_problem(server: Server, session: str) -> None:
    problem(server.http.get("/api/v1/sessions/nowhere/stream"), 404)
    server.http.post("/api/v1/sessions", json={"spec": "single", "id": session})
    for last in ("x", "-1", "1.5", "9" * 30, "\u0663"):
        headers = [(b"Last-Event-ID", last.encode())]
        problem(server.http.get(f"/api/v1/sessions/{session}/stream", headers=headers), 422)


async def test_a_reader_that_stops_is_cut_off_and_slows_nobody(start: Starts) -> None:
    server = start()
    host, port = server.url.removeprefix("http://").split(":")
    async with attached(server, session="s", spec="single") as monitor:
        with socket.socket() as lazy:
            lazy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            lazy.connect((host, int(port)))
            lazy.send(f"GET /api/v1/sessions/s/stream HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode())
            way, count, most = (int(port), lazy.getsockname()[1]), 0, 0
            while count < 10_000:  # several megabytes of records
                await monitor.send(make_events(*numbered(count + 1, count + 2000)))
                count += 2000
                await monitor.acked(count)
                most = max(most, unread(*way))
            most = max(most, await server.until(lambda: unread(*way), bool))  # where the reading process began late
            assert most < 2**19, "as much as one client may leave, whatever there is to read"
            async with stream(server, "s") as events:
                assert [r["n"] for r in await take(events, count)] == list(range(1, count + 1))
            await server.until(lambda: connections(*way), lambda found: not found)
            assert server.get("sessions/s")["counters"]["steps"] == count


def unread(local: int, remote: int) -> int:
    """Bytes that wait in the system for whom a connection goes to."""
    return sum(int(line[4].partition(":")[0], 16) for line in connections(local, remote))


def connections(local: int, remote: int) -> list[list[str]]:
    """The line of the system's table for a connection that some process still holds."""
    lines = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    ends = (f":{local:04X}", f":{remote:04X}")
    return [line for line in lines if (line[1][-5:], line[2][-5:]) == ends and line[3] == "01"]


async def test_a_stream_ends_with_its_server_and_goes_on_with_the_next(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="single") as monitor:
        await monitor.send(*numbered(1, 5))
        await monitor.acked(5)
        async with stream(server, "s") as events:
            assert len(await take(events, 5)) == 5
            stopping = asyncio.create_task(asyncio.to_thread(server.stop))
            async with asyncio.timeout(PATIENCE):
                assert [event async for event in events] == []
                assert await stopping == 0
    server = start()
    async with stream(server, "s", last=3) as events:
        assert [r["n"] for r in await take(events, 2)] == [4, 5]


@pytest.mark.parametrize("as_json", [True, False])
async def test_the_command_line_follows(server: Server, session: str, as_json: bool) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(*numbered(1, 3))
        await monitor.acked(3)
        command = [COMMAND, "verdicts", session, "--follow", "--url", server.url, *(["--json"] if as_json else [])]
        process = await asyncio.create_subprocess_exec(*command, stdout=subprocess.PIPE, env=environment())
        assert process.stdout is not None
        async with asyncio.timeout(PATIENCE):
            lines = [await process.stdout.readline() for _ in range(3)]
            await monitor.send(*numbered(4, 6))
            lines += [await process.stdout.readline() for _ in range(3)]
            await monitor.detach()
            server.http.delete(f"/api/v1/sessions/{session}")
            assert await process.wait() == 0
    records = server.records(session)
    if as_json:
        assert [json.loads(line) for line in lines] == records
    else:
        assert [line.split()[0] for line in lines] == [str(r["n"]).encode() for r in records]


async def summary_of(events: AsyncIterator[Event], state: dict[str, Any]) -> str:
    """Take the next event of a stream of summaries into a state, as a page does; its name."""
    keys = {"properties": ("id", "order"), "streams": ("monitor", "stream", "kind"), "monitors": ("name",)}
    async with asyncio.timeout(PATIENCE):
        event = await anext(events)
    for key, value in json.loads(event["data"]).items():
        if key in keys and key in state:
            rows = {tuple(row[k] for k in keys[key]): row for row in (*state[key], *value)}
            state[key] = [*rows.values()]
        else:
            state[key] = value
    return event["event"]


async def test_a_summary_is_the_state_and_then_what_has_changed(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_events(*numbered(1, 5)))
        await monitor.acked(5)
        async with stream(server, session, summary="true") as events:
            state: dict[str, Any] = {}
            assert await summary_of(events, state) == "summary"
            whole = server.get(f"sessions/{session}")
            assert state.keys() == whole.keys() - {"hold"}
            assert state["properties"] == whole["properties"]
            await monitor.send(make_event(6, at=6, data={"v": 11}))
            while state["properties"][0]["violations"] == 0:
                assert await summary_of(events, state) == "summary"
            await monitor.detach()
            while state["live"]:
                assert await summary_of(events, state) == "summary"
            server.http.delete(f"/api/v1/sessions/{session}")
            names = []
            while "closed" not in names:
                names.append(await summary_of(events, state))
    assert {*names[:-1]} <= {"summary"}
    assert (state["status"], state["closed_because"]) == ("closed", "by request")
    problem(server.http.get(f"/api/v1/sessions/{session}/stream?summary=true&after=3"), 422)
    problem(server.http.get("/api/v1/sessions/nowhere/stream?summary=true"), 404)


async def next_of(events: AsyncIterator[Event], count: int) -> list[tuple[str, dict[str, Any]]]:
    """The next events by their kinds, with what they have."""
    async with asyncio.timeout(PATIENCE):
        found = [await anext(events) for _ in range(count)]
    return [(event["event"], json.loads(event["data"])) for event in found if event["event"] != "closed"]


async def test_an_episode_is_told_where_it_begins_and_where_it_ends(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="pair", streams=["/a"]) as monitor:
        await monitor.send(*[make_event(i, at=i * 500, data={"v": 99 if i in (2, 3) else 1}) for i in (1, 2)])
        await monitor.acked(2)
        async with (
            stream(server, session, "episodes/stream", property="a_is_small") as events,
            stream(server, session, "episodes/stream", property="never_zero") as none,
        ):
            ((kind, begun),) = await next_of(events, 1)
            assert (kind, begun["first"], begun["open"], begun["count"]) == ("begun", 8, True, 1)
            assert begun["explanation"].startswith("a_is_small does not hold at step 2")
            await monitor.send(*[make_event(i, at=i * 500, data={"v": 99 if i in (3, 9) else 1}) for i in range(3, 10)])
            told = await next_of(events, 2)
            assert [(kind, e["first"], e["last"], e["open"]) for kind, e in told] == [
                ("ended", 8, 14, False), ("begun", 50, None, True),
            ]  # fmt: skip
            await monitor.detach()
            assert server.http.delete(f"/api/v1/sessions/{session}").status_code == 200
            async with asyncio.timeout(PATIENCE):
                rest = [event async for event in events]
                assert [event["event"] async for event in none] == ["closed"]
    assert [event["event"] for event in rest] == ["ended", "closed"]
    assert json.loads(rest[0]["data"])["last"] == 50


async def test_an_episode_of_which_nothing_stands_is_retracted(server: Server, session: str) -> None:
    async with (
        attached(server, session=session, spec="revising") as monitor,
        stream(server, session, "episodes/stream") as events,
    ):
        await monitor.send(make_event(1, "/b", at=1000, data={"v": 1}), make_event(2, "/b", at=1200, data={"v": 2}))
        ((_, begun),) = await next_of(events, 1)
        await monitor.send(make_event(3, "/a", at=900, data={"v": 1}))
        told = await next_of(events, 2)
        assert [(kind, e["first"], e["moved"]) for kind, e in told] == [
            ("retracted", begun["first"], True), ("begun", begun["first"] + 1, True),
        ]  # fmt: skip
        await monitor.send(make_event(4, "/a", at=1100, data={"v": 2}))
        ((kind, retracted),) = await next_of(events, 1)
        assert (kind, retracted["first"], retracted["moved"]) == ("retracted", begun["first"] + 1, False)
