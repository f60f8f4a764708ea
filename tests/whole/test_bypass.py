"""What reaches the robot past its monitor, in a served session."""

from __future__ import annotations

import asyncio
import json
import signal
from pathlib import Path
from typing import Any

import pytest

from tests.whole.client import Monitor, attached, make_clock, make_event, stable
from tests.whole.conftest import Starts
from tests.whole.harness import Server, run

SPEC = Path(__file__).parent / "specs" / "bypassed.yaml"
PATIENT = {"ORACLE_RESUME_WITHIN": "3600"}
TEXT = "/rogue publishes /a past the monitor"


def make_report(text: str, stream: str = "/a") -> dict[str, Any]:
    return {"type": "report", "streams": [{"stream": stream, "kind": "topic", "trouble": text, "bypass": text}]}


async def events(monitor: Monitor, seq: int) -> None:
    """One of each stream."""
    await monitor.send(make_event(seq, "/a", at=seq, data={"v": 1}), make_event(seq + 1, "/b", at=seq + 1))
    await monitor.send(make_clock("/a", at=seq + 2), make_clock("/b", at=seq + 2))
    await monitor.acked(seq + 1)


def caveats(server: Server) -> dict[str, list[str]]:
    return {p["id"]: p["caveats"] for p in server.get("sessions/s")["properties"]}


def degraded(server: Server, name: str) -> list[bool]:
    return [r["degraded"] for r in server.records("s", property=name)]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
async def test_while_a_stream_is_bypassed_its_properties_are_degraded_and_say_why(
    start: Starts, tmp_path: Path, number: signal.Signals
) -> None:
    server = start(**PATIENT)
    async with attached(server, session="s", spec="bypassed", verdicts=True) as monitor:
        await events(monitor, 1)
        assert not any(caveats(server).values())
        await monitor.send(make_report(TEXT))
        while True:
            frame = await monitor.expect("verdicts")
            shown = frame["properties"]["a_is_small"]
            if TEXT in shown["text"]:
                break
        assert shown["level"] == "warn"
        assert shown["text"].startswith(f"holds; degraded: {TEXT} since 20")
        assert frame["properties"]["other"]["text"] == "holds"
        before = caveats(server)
        assert [before[name][0].split(" since ")[0] for name in ("a_is_small", "b_after_a")] == [TEXT, TEXT]
        assert before["other"] == []
        await events(monitor, 3)
        server.stop(number)
    server = start(**PATIENT)
    assert caveats(server) == before, "as the monitor told last"
    async with attached(server, session="s") as monitor:
        await events(monitor, 5)
        await monitor.send(make_report(""))
        await server.until(lambda: caveats(server), lambda found: not any(found.values()))
        await events(monitor, 7)
    for name in ("a_is_small", "b_after_a"):
        assert degraded(server, name) == [False, False, True, True, True, True, False, False]
    assert not any(degraded(server, "other"))
    records = server.records("s")
    assert server.stop() == 0
    server = start(**PATIENT)
    assert server.records("s") == records
    async with attached(server, session="s") as monitor:
        await events(monitor, 9)
    assert degraded(server, "a_is_small")[-2:] == [False, False], "it ended, unlike a loss"
    trace = tmp_path / "s.jsonl"
    assert run("record", "s", "-o", trace, ORACLE_URL=server.url).returncode == 0
    *again, _ = map(json.loads, run("replay", SPEC, trace, "--json").stdout.splitlines())
    assert stable(again) == stable(server.records("s"))


async def test_people_are_told_what_is_degraded_and_a_monitor_that_leaves_tells_no_more(start: Starts) -> None:
    server = start(**PATIENT)
    async with attached(server, session="s", spec="bypassed") as monitor:
        await monitor.send(make_report(TEXT), make_event(1, "/b"))
        await monitor.send(make_clock("/a", at=9), make_clock("/b", at=9))
        await monitor.acked(1)
        for words in (("sessions",), ("verdicts", "s")):
            shown = (await asyncio.to_thread(run, *words, ORACLE_URL=server.url)).stdout
            assert f"a_is_small is degraded: {TEXT} since 20" in shown
            assert "other is degraded" not in shown
        await monitor.detach()
    assert not any(caveats(server).values())


async def test_people_are_told_what_else_is_wrong_with_a_stream(start: Starts) -> None:
    server = start(**PATIENT)
    async with attached(server, session="s", spec="bypassed") as monitor:
        trouble = {"stream": "/a", "kind": "topic", "trouble": "nobody publishes /a; did you mean /A?"}
        await monitor.send({"type": "report", "streams": [trouble]}, make_event(1, "/b"))
        await monitor.send(make_clock("/a", at=9), make_clock("/b", at=9))
        await monitor.acked(1)
        for words in (("sessions",), ("verdicts", "s")):
            shown = (await asyncio.to_thread(run, *words, ORACLE_URL=server.url)).stdout
            assert "/a: nobody publishes /a; did you mean /A?\n" in shown


async def test_a_new_process_that_does_not_claim_a_stream_knows_nothing_of_its_bypass(start: Starts) -> None:
    server = start(**PATIENT)
    async with attached(server, session="s", spec="bypassed", instance="one") as monitor:
        await monitor.send(make_report(TEXT), make_report(TEXT, "/b"))
        await server.until(lambda: caveats(server), lambda found: len(found["b_after_a"]) == 2)
    async with attached(server, session="s", instance="two", streams=["/b"]) as monitor:
        left = "no monitor observes /a any more"
        assert caveats(server)["a_is_small"] == [left]
        assert len(caveats(server)["b_after_a"]) == 2, "of a stream that it claims, what was known stands"
        await monitor.send(make_report("", "/b"))
        await server.until(lambda: caveats(server), lambda found: found["b_after_a"] == [left])


async def test_what_older_adapters_report_degrades_nothing(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="bypassed") as monitor:
        await monitor.send({"type": "report", "streams": [{"stream": "/a", "trouble": TEXT}]})
        await events(monitor, 1)
    assert not any(degraded(server, "a_is_small"))
