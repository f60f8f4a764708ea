"""What never comes, in a served session: also where the server dies meanwhile."""

from __future__ import annotations

import json
import signal
from pathlib import Path
from typing import Any

from tests.whole.client import attached, make_event, stable
from tests.whole.conftest import Starts
from tests.whole.harness import Server, run

SPEC = Path(__file__).parent / "specs" / "presence.yaml"
SECOND = 10**9


def ticks(server: Server) -> list[dict[str, Any]]:
    return [r for r in server.records("s") if r["kind"] == "tick"]


async def test_a_robot_that_never_speaks_is_missed(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="presence") as monitor:
        (told,) = await monitor.violated(1)
        begun = server.get("sessions/s")["begun"]
        assert (told["n"], told["kind"], told["step"], told["stamp"]) == (1, "tick", None, begun + SECOND)
    assert server.stop() == 0
    server = start()
    assert server.records("s") == ticks(server)
    assert [r["n"] for r in ticks(server)] == [1]


async def test_the_grace_goes_on_where_it_was_when_the_server_died(start: Starts, tmp_path: Path) -> None:
    server = start(ORACLE_RESUME_WITHIN="3600")
    async with attached(server, session="s", spec="presence") as monitor:
        await monitor.send(make_event(1, "/b"))
        await monitor.acked(1)
        begun = server.get("sessions/s")["begun"]
        server.stop(signal.SIGKILL)
    server = start(ORACLE_RESUME_WITHIN="3600")
    assert server.get("sessions/s")["begun"] == begun
    async with attached(server, session="s") as monitor:
        await server.until(lambda: ticks(server), bool)
        await monitor.send(make_event(2, "/a"))
        await monitor.acked(2)
        await server.until(lambda: ticks(server), lambda found: len(found) == 2)
    records = server.records("s")
    first = records[0]
    # a slow machine may take longer than the grace to its first event
    assert first["outcome"] == ("unknown" if first["arrived"] < begun + SECOND else "currently_false")
    if first["outcome"] == "unknown":
        asked = run("verdicts", "s", "--explain", "1", ORACLE_URL=server.url)
        assert "the session began less than 1 s before, so that nothing is missing yet" in asked.stderr
    assert [(r["kind"], r["outcome"]) for r in records[-3:]] == [
        ("tick", "currently_false"),
        ("topic", "currently_true"),
        ("tick", "currently_false"),
    ]
    assert records[-3]["stamp"] == begun + SECOND
    assert not any(r["degraded"] for r in records)
    trace = tmp_path / "s.jsonl"
    assert run("record", "s", "-o", trace, ORACLE_URL=server.url).returncode == 0
    *again, _ = map(json.loads, run("replay", SPEC, trace, "--json").stdout.splitlines())
    assert stable(again) == stable(records)
