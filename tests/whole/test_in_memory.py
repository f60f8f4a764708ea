"""A server whose history is in memory does all that another does, and leaves nothing behind."""

from __future__ import annotations

import json
from typing import Any

from tests.whole.client import Frame, attached, stable
from tests.whole.conftest import Starts
from tests.whole.harness import Server
from tests.whole.stories import play, tell

STORY = tell(11, chunks=6)
CLAIMED = ["/a", "/b", "/go", "/free"]


async def played(server: Server) -> dict[int, Frame]:
    """The decisions of the story; each chunk is sent by a connection of its own."""
    decisions: dict[int, Frame] = {}
    for chunk in STORY:
        async with attached(server, session="s", spec="pair", streams=CLAIMED) as monitor:
            decisions |= await play(monitor, chunk)
    return decisions


def seen(server: Server) -> dict[str, Any]:
    """All that can be asked about the session, without what depends on when it was made."""
    violations = server.records("s", "violations")
    lines = [json.loads(line) for line in server.http.get("/api/v1/sessions/s/trace").text.split("\n") if line]
    return {
        "records": stable(server.records("s")),
        "newest": stable(server.records("s", order="desc", outcome="currently_false")),
        "violations": stable(violations),
        "explained": [server.get(f"sessions/s/verdicts/{r['n']}/explanation")["explanation"] for r in violations],
        "trace": sorted(
            (line["monitor"], line["seq"], line["signals"], line["passed"]) for line in lines if line["seq"]
        ),
        "counters": server.get("sessions/s")["counters"],
    }


async def test_it_is_seen_as_on_disk_and_ends_with_the_process(start: Starts) -> None:
    server = start(ORACLE_HISTORY="memory")
    assert "in memory" in server.log
    decisions, found = await played(server), seen(server)
    assert found["violations"]
    assert decisions
    assert server.http.delete("/api/v1/sessions/s").json()["status"] == "closed"
    assert [state["status"] for state in server.get("sessions")["items"]] == ["closed"]
    assert server.stop() == 0
    assert not list(server.data.glob("history*"))
    server = start()
    assert server.get("sessions")["items"] == []
    assert await played(server) == decisions
    assert seen(server) == found


async def test_an_event_that_is_sent_again_is_answered(start: Starts) -> None:
    server = start(ORACLE_HISTORY="memory")
    decisions = await played(server)
    seq, decision = next(iter(decisions.items()))
    event = next(event for chunk in STORY for event in chunk.events if event["seq"] == seq)
    async with attached(server, session="s", spec="pair", streams=CLAIMED) as monitor:
        await monitor.send(event)
        assert await monitor.expect("decision", seq=seq) == decision
