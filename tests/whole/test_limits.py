"""The limits that docs/security.md states: each test tries to go beyond one."""

from __future__ import annotations

import asyncio
import json
import time
from contextlib import suppress

import pytest

from oracle_server.attach.throttle import Throttle
from oracle_server.wire.incoming import MAX_KEYS
from tests.whole.client import attached, connected, make_event, make_events, seqs
from tests.whole.conftest import Starts
from tests.whole.harness import PATIENCE, Server, problem


async def test_a_frame_that_is_too_long_ends_the_connection(server: Server) -> None:
    async with attached(server, spec="single") as monitor:
        limit = monitor.attached["limits"]["max_frame"]
        with suppress(ConnectionError):
            await monitor.send_text('{"type":"event","data":"' + "x" * limit + '"}')
        _, code = await monitor.closed()
        assert code == 1009


async def test_data_with_too_many_keys_is_refused(server: Server, session: str) -> None:
    keys = json.dumps({f"{i:x}": {} for i in range(MAX_KEYS)}, separators=(",", ":"))
    async with attached(server, session=session, spec="single") as monitor:
        for seq, data in enumerate((f'{{"v":{keys}}}', f'{{"v":[{keys[:-1]},"z":1}}]}}'), start=1):
            await monitor.send_text(f'{{"type":"event","seq":{seq},"stream":"/a","data":{data}}}')
            error = await monitor.expect("error", code="bad_event", seq=seq)
            assert "keys" in error["message"]
        await monitor.send(make_event(3, at=3, data={"v": 1}))
        await monitor.acked(3)
    assert seqs(server, session) == [3]


async def test_data_that_is_too_deep_or_a_number_that_is_too_long_is_refused(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        for seq, value in enumerate(("[" * 65 + "]" * 65, str(2**64), str(-(2**63) - 1)), start=1):
            text = f'{{"type":"event","seq":{seq},"stream":"/a","stamp":{seq},"data":{{"v":{value}}}}}'
            await monitor.send_text(text)
            await monitor.expect("error", code="bad_event", seq=seq)
        await monitor.send(make_event(4, at=4, data={"v": 1}))
        await monitor.acked(4)
    assert seqs(server, session) == [4]


TOO_LARGE = {
    "a formula that is too long": ("{v: " + "1" * 30 + "} and " * 3_000 + "{v: 1}", "characters"),
    "a formula that is too deep": ("(not " * 200 + "{v: 1}" + ")" * 200, "deep"),
    "a window that is too long": ("once[:1000000000000000001]{v: 1}", "too large"),
    "a number that is too long": ("{v: " + "1" * 50 + "}", "too long"),
}


@pytest.mark.parametrize(("formula", "why"), TOO_LARGE.values(), ids=TOO_LARGE)
def test_a_formula_that_is_too_large_is_refused(server: Server, formula: str, why: str) -> None:
    text = f"id: large\nstreams:\n  - topic: /a\nproperties:\n  - {{id: p, formula: '{formula}'}}\n"
    body = problem(server.http.put("/api/v1/specs/large", content=text), 422)
    assert why in str(body)
    problem(server.http.get("/api/v1/specs/large"), 404)


def test_a_spec_that_is_too_long_is_refused(server: Server) -> None:
    text = "id: large\nstreams:\n  - topic: /a\nproperties:\n  - {id: p, formula: '{v: 1}'}\n" + "#" * 262_144
    assert "characters" in str(problem(server.http.put("/api/v1/specs/large", content=text), 422))
    problem(server.http.get("/api/v1/specs/large"), 404)


async def test_who_says_nothing_or_half_a_word_is_not_waited_for(server: Server) -> None:
    """All at once, as each takes as long as the server is patient."""
    host, port = server.url.removeprefix("http://").split(":")

    async def rest(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bytes:
        async with asyncio.timeout(PATIENCE):
            try:
                return await reader.read()
            except ConnectionResetError:
                return b""
            finally:
                writer.close()

    async def ended(*texts: str) -> bytes:
        reader, writer = await asyncio.open_connection(host, int(port))
        for text in texts:
            writer.write(text.encode())
        return await rest(reader, writer)

    async def trickled() -> bytes:
        reader, writer = await asyncio.open_connection(host, int(port))
        writer.write(b"GET /healthz HTTP/1.1\r\n")
        read = asyncio.create_task(reader.read())
        async with asyncio.timeout(PATIENCE):
            while not read.done():
                with suppress(ConnectionError):
                    writer.write(b"X-Slow: yes\r\n")
                await asyncio.wait((read,), timeout=0.5)
        writer.close()
        return b"" if read.exception() else read.result()

    async def left_off() -> bytes:
        """A request that is answered before all of its body has come, whose rest then does not come."""
        reader, writer = await asyncio.open_connection(host, int(port))
        head = f"POST /api/v1/recordings?spec=none HTTP/1.1\r\nHost: {host}:{port}\r\nContent-Length: 1000\r\n\r\n"
        writer.write(head.encode())
        async with asyncio.timeout(PATIENCE):
            await reader.readuntil(b"}")
        writer.write(first.encode())
        return await rest(reader, writer)

    async def silent() -> list[dict[str, object]]:
        async with connected(server) as monitor:
            frames, code = await monitor.closed()
            assert code == 1008
            return frames

    first = f"GET /healthz HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n"
    nothing, half, again, slow, unanswered, frames = await asyncio.gather(
        ended(), ended("GET /healthz HTTP/1.1\r\nHo"), ended(first, first[:20]), trickled(), left_off(), silent()
    )
    assert (nothing, half, slow, unanswered) == (b"", b"", b"", b"")
    assert again.count(b"HTTP/1.1 200 ") == 1
    assert [f["code"] for f in frames] == ["bad_attach"]


def test_a_body_that_is_too_long_is_refused_whatever_it_is_for(server: Server) -> None:
    long = b'{"spec": "' + b"x" * 2**20 + b'"}'
    problem(server.http.post("/api/v1/sessions", content=long), 413)
    problem(server.http.post("/api/v1/sessions", content=iter([long[:600_000]] * 2)), 413)
    problem(server.http.put("/api/v1/specs/long", content=long), 413)


async def test_a_flood_is_read_slowly_and_told_once_and_others_go_on(start: Starts) -> None:
    server, count = start(ORACLE_MAX_RATE="400"), 1600
    async with (
        attached(server, "flood", session="flooded", spec="single") as flood,
        attached(server, "calm", session="calm", spec="single") as calm,
    ):
        await flood.send(make_events(*(make_event(i, at=i, data={"v": 1}) for i in range(1, count + 1))))
        told = await flood.expect("error", code="throttled")
        assert told["fatal"] is False
        asked = 0
        while flood.upto < count:
            asked += 1
            decision = await calm.ask(asked, at=asked, data={"v": 1})
            assert decision["decision"] == "allow"
            with suppress(TimeoutError):
                async with asyncio.timeout(0.05):
                    frame = await flood.recv()
                    assert frame["type"] in ("ack", "credit")
        assert asked > 1
        await calm.detach()
    assert seqs(server, "flooded") == list(range(1, count + 1))
    assert "oracle_throttled_total" in server.http.get("/metrics").text


def test_the_throttle_lets_a_burst_through_and_then_the_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr(time, "monotonic", lambda: now)
    throttle = Throttle(1000)
    for _ in range(1999):
        throttle.count()
    assert throttle.must_yield
    assert throttle.pause() == 0
    for _ in range(1000):
        throttle.count()
    assert throttle.pause() == pytest.approx(0.999)
    now += 0.5
    assert throttle.pause() == pytest.approx(0.499)
    unbounded = Throttle(0)
    for _ in range(10**6):
        unbounded.count()
    assert unbounded.pause() == 0


async def test_a_formula_that_explodes_is_told_and_costs_the_others_nothing(server: Server, session: str) -> None:
    """Two sessions side by side: one is judged no more where it would cost too much, the other as if it were alone."""
    spec = f"greedy-{session}"
    formula = 'exists[w, x, y, z]. ({topic: "/a", k: *x} or {l: *y} or {k: *w}) since ({k: *y} or {l: *z} or {l: *w})'
    properties = f"  - {{id: greedy, formula: '{formula}'}}\n  - {{id: small, formula: '{{v > 0}}', guards: [/a]}}\n"
    text = f"id: {spec}\nstreams:\n  - {{topic: /a, action: filter}}\nproperties:\n{properties}"
    assert server.http.put(f"/api/v1/specs/{spec}", content=text).status_code == 201
    failures = engine_failures(server)
    async with (
        attached(server, session=session, spec=spec) as bad,
        attached(server, session=f"{session}-good", spec="single") as good,
    ):
        outcomes: dict[str, set[str]] = {"greedy": set(), "small": set()}
        for i in range(1, 201):
            decision = await bad.ask(i, at=i, data={"k": i, "l": i * 7, "v": 1})
            assert decision["decision"] == "allow", "what is broken does not guard"
            for name, outcome in decision["verdicts"].items():
                outcomes[name].add(outcome)
            assert (await good.ask(i, at=i, data={"v": 1}))["verdicts"] == {"a_is_small": "currently_true"}
        await bad.acked(200)
    assert "unknown" in outcomes["greedy"]
    assert outcomes["small"] == {"currently_true"}
    states = {p["id"]: p for p in server.get(f"sessions/{session}")["properties"]}
    assert "cost too much" in states["greedy"]["broken"]
    unknown = [r for r in server.records(session, property="greedy") if r["outcome"] == "unknown"]
    assert states["greedy"]["unknown"] == len(unknown) > 100
    assert all(r["degraded"] for r in unknown[1:])
    assert states["small"]["broken"] is None
    assert engine_failures(server) == failures + 1
    server.said("a property is no longer judged")


def engine_failures(server: Server) -> float:
    text = server.http.get("/metrics").text
    return next(float(line.split()[1]) for line in text.splitlines() if line.startswith("oracle_engine_failures_total"))
