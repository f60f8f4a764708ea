"""Sessions that are closed while they are at work."""

from __future__ import annotations

import asyncio
import contextlib

from websockets.exceptions import ConnectionClosed

from tests.whole.client import attached, judged, make_event, seqs
from tests.whole.harness import Server


async def test_deleting_a_session_judges_what_it_holds_and_tells_its_monitors(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="slow") as monitor:
        await monitor.send(make_event(1, "/b", at=20), make_event(2, "/b", at=10, source="another"))
        await server.holds(session, 2)
        response = server.http.delete(f"/api/v1/sessions/{session}")
        assert response.status_code == 200
        assert response.json()["status"] == "closed"
        frames, code = await monitor.closed()
        assert code == 1008
        assert [f.get("code", f.get("upto")) for f in frames if f["type"] != "violation"][-2:] == [2, "session_closed"]
    assert judged(server, session) == [("m1", "/b", 2), ("m1", "/b", 1)]
    assert not any(r["late"] for r in server.records(session))
    assert server.get(f"sessions/{session}")["counters"]["held"] == 0


async def test_what_comes_while_a_session_is_closed_is_judged_wholly_or_not_at_all(
    server: Server, session: str
) -> None:
    async with attached(server, session=session, spec="single") as monitor:

        async def flood() -> None:
            for seq in range(1, 100_000):
                await monitor.send(make_event(seq, at=seq, data={"v": 1}))

        flooding = asyncio.create_task(flood())
        await monitor.acked(1000)
        closing = asyncio.create_task(asyncio.to_thread(server.http.delete, f"/api/v1/sessions/{session}"))
        frames, _ = await monitor.closed()
        with contextlib.suppress(ConnectionClosed):
            await flooding
        state = (await closing).json()
    told = [f["code"] for f in frames if f["type"] == "error"]
    assert told in (["session_closed"], ["throttled", "session_closed"]), "it may have been quick"
    assert seqs(server, session) == list(range(1, state["counters"]["steps"] + 1))
    assert monitor.upto == state["counters"]["steps"]
    assert server.get(f"sessions/{session}") == state
