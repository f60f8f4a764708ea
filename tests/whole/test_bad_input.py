"""What a broken or hostile client may send: it is told, loses nothing that was taken, and harms nobody else."""

from __future__ import annotations

import asyncio
import contextlib

import pytest
from websockets.exceptions import ConnectionClosed

from tests.whole.client import attached, connected, good, make_attach, make_event, make_events, seqs
from tests.whole.conftest import Starts
from tests.whole.harness import Server

pytestmark = pytest.mark.usefixtures("bystander")

EVENT = '{"type":"event","seq":1,"stream":"/a","stamp":1732147200000000000,"data":%s}'
FIELD = '{"type":"event","seq":1,"stream":"/a","stamp":1732147200000000000,"data":{},%s}'


async def test_what_comes_before_attach_or_a_second_attach_is_refused(server: Server, session: str) -> None:
    async with connected(server) as connection:
        await connection.send(make_event(1), make_attach(session=session, spec="single"))
        frames, code = await connection.closed()
        assert code == 1008
        assert [f.get("code") for f in frames] == ["bad_attach"]
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_attach(session=session, spec="single"))
        await monitor.expect("error", code="bad_attach")
        await good(monitor, 1)


@pytest.mark.parametrize("text", [b"", b"\x00\xff", b'{"type":"event","seq":1,"stream":"/a","data":{}}'])
async def test_a_frame_of_bytes_ends_the_connection_and_not_the_session(
    server: Server, session: str, text: bytes
) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await good(monitor, 1)
        await monitor.send_text(text)
        frames, code = await monitor.closed()
        assert code in (1003, 1008)
        assert [f["type"] for f in frames] == ["error"]
    async with attached(server, session=session, spec="single") as monitor:
        assert monitor.attached["next"] == 2
        await good(monitor, 2)
    assert seqs(server, session) == [1, 2]


async def test_text_that_is_no_utf8_ends_the_connection_and_not_the_session(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await good(monitor, 1)
        await monitor.socket.send(b'{"type":"\xff\xfe"}', text=True)
        _, code = await monitor.closed()
        assert code == 1007
    async with attached(server, session=session, spec="single") as monitor:
        await good(monitor, 2)
    assert seqs(server, session) == [1, 2]


@pytest.mark.parametrize("pieces", [0, 1, 64], ids=["announced", "at_once", "in_pieces"])
async def test_a_frame_over_the_limit_ends_the_connection_and_not_the_session(
    server: Server, session: str, pieces: int
) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await good(monitor, 1)
        limit = monitor.attached["limits"]["max_frame"]
        text = EVENT.replace('"seq":1', '"seq":2') % '{"x":"%s"}'
        await monitor.send_text(text % ("x" * (limit - len(text) + 2)))
        await monitor.acked(2)
        too_long = text.replace('"seq":2', '"seq":3') % ("x" * (limit - len(text) + 3))
        if pieces:
            size = len(too_long) // pieces + 1
            with contextlib.suppress(ConnectionClosed):
                await monitor.socket.send([too_long[i : i + size] for i in range(0, len(too_long), size)])
        else:
            monitor.socket.transport.write(b"\x81\xff" + len(too_long).to_bytes(8) + b"mask")
        _, code = await monitor.closed()
        # a client that is still writing when the server closes may never see why
        assert code == 1009 or (pieces and code is None)
    async with attached(server, session=session, spec="single") as monitor:
        assert monitor.attached["next"] == 3
        await good(monitor, 3)
    assert seqs(server, session) == [1, 2, 3]


async def test_a_client_that_vanishes_in_the_middle_of_a_frame_loses_only_that(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        batch = make_events(*(make_event(seq, at=seq, data={"v": 1}) for seq in range(1, 101)))
        await monitor.send(batch)
        monitor.socket.transport.write(
            b"\x81\xfe\x10\x00" + b"\x00\x00\x00\x00" + b'{"type":"events","events":[{"type":"event"'
        )
        monitor.vanish()
    await server.until(lambda: seqs(server, session), lambda found: found in ([], list(range(1, 101))))
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(batch)
        await monitor.acked(100)
        await good(monitor, 101)
    assert seqs(server, session) == list(range(1, 102))
    assert not any(r["degraded"] for r in server.records(session))


HALVES = (
    b"",
    b"\x00\x01\x02\xff" * 100,
    b"GET / HTTP/1.1\r\n",
    b"GET /api/v1/attach HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\n",
    b"GET /api/v1/attach HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\r\n",
    b"POST /api/v1/sessions HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 1000\r\n\r\n{",
    b"PUT /api/v1/specs/x HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\nffff\r\nid: x",
    b"GET /" + b"x" * 100_000 + b" HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
)


async def test_clients_that_speak_no_http_or_stop_in_its_middle_do_no_harm(start: Starts) -> None:
    server = start()
    port = int(server.url.rsplit(":", 1)[1])
    for said in HALVES:
        _, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(said)
        with contextlib.suppress(OSError):  # the server may have had enough of it already
            await writer.drain()
        writer.transport.abort()
        with contextlib.suppress(OSError):
            await writer.wait_closed()
        assert server.http.get("/healthz").status_code == 200
    assert server.stop() == 0


@pytest.mark.parametrize("after", ["handshake", "attach", "batch"])
async def test_clients_that_vanish_at_once_do_no_harm(server: Server, session: str, after: str) -> None:
    async def flash(number: int) -> None:
        async with connected(server) as connection:
            if after != "handshake":
                await connection.send(make_attach(f"m{number}", session=session, spec="single"))
            if after == "batch":
                await connection.send(make_events(*(make_event(i, data={"v": 1}) for i in range(1, 50))))
            connection.vanish()

    await asyncio.gather(*(flash(number) for number in range(20)))
    async with attached(server, "last", session=session, spec="single") as monitor:
        await monitor.send(make_event(1, data={"v": 1}))
        await monitor.detach()
    found: dict[str, list[int]] = {}
    for r in server.records(session):
        found.setdefault(r["monitor"], []).append(r["seq"])
    assert found.pop("last") == [1]
    assert all(numbers == list(range(1, len(numbers) + 1)) for numbers in found.values())


async def test_a_monitor_that_does_not_read_is_cut_off_and_goes_on_from_the_record(
    server: Server, session: str
) -> None:
    count, size = 100_000, 5_000
    events = [{"seq": i, "stream": "/a", "stamp": i, "data": {"v": 1}, "ask": True} for i in range(1, count + 1)]

    def is_connected() -> bool:
        return bool(server.get(f"sessions/{session}")["monitors"][0]["connected"])

    async with attached(server, session=session, spec="single") as monitor:

        async def flood() -> None:
            for start in range(0, count, size):
                await monitor.send(make_events(*events[start : start + size]))

        flooding = asyncio.create_task(flood())
        await server.until(is_connected, lambda connected: not connected)
        flooding.cancel()
        frames, _ = await monitor.closed()
        decided = [f["seq"] for f in frames if f["type"] == "decision"]
        assert decided == list(range(1, len(decided) + 1))
        assert 0 < len(decided) < count
        with contextlib.suppress(asyncio.CancelledError, ConnectionClosed):
            await flooding
    async with attached(server, session=session, spec="single") as monitor:
        following = monitor.attached["next"]
        await monitor.send(make_events(*events[following - 1 : following + 9]))
        await monitor.acked(following + 9)
        await monitor.send(make_events(*events[:3]))
        for seq in (1, 2, 3):
            while (frame := await monitor.recv())["type"] != "decision" or frame["seq"] > following:
                pass
            assert (frame["seq"], frame["decision"]) == (seq, "allow")
    # in a thread, since there is much, and who stands by must go on meanwhile
    assert set(range(1, following + 10)) <= set(await asyncio.to_thread(seqs, server, session))
