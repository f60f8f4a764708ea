"""What a live session judged, and what the replay of its recording judges, are the same records."""

from __future__ import annotations

import asyncio
import json
import random
from pathlib import Path
from typing import Any

import pytest

from tests.whole.client import Monitor, attached, make_clock, make_event
from tests.whole.conftest import SPECS
from tests.whole.harness import Server, failed, run

STREAMS = {
    "lamp": [("/light", "topic"), ("/battery", "topic"), ("/switch", "request"), ("/switch", "response")],
    "both": [("/a", "topic"), ("/b", "topic")],
    "deadline": [("/a", "topic"), ("/b", "topic")],
}


def spec_of(name: str) -> Path:
    return next(path for folder in SPECS for path in folder.glob(f"{name}.yaml"))


def data_of(dice: random.Random) -> dict[str, Any]:
    value = dice.choice([3, 300, "NaN", None, 2.5])
    return {"level": value, "percentage": value, "switch_on": dice.choice([True, False]), "v": dice.choice([1, 2, 3])}


async def live(server: Server, session: str, spec: str, dice: random.Random) -> None:
    """Two monitors whose events are late, lost, asked about, refused, and freed by clocks in no order."""

    async def speak(name: str, monitor: Monitor) -> None:
        seq = at = 0
        for _ in range(60):
            seq += dice.choice([1, 1, 1, 1, 1, 1, 1, 3])
            at += dice.choice([-15, 1, 1, 2, 20])
            stream, kind = dice.choice(STREAMS[spec])
            if dice.random() < 0.05:
                await monitor.send(make_event(seq, "/nowhere", max(at, 1)))
                continue
            ask = dice.random() < 0.3
            event = make_event(seq, stream, max(at, 1), data_of(dice), kind=kind, ask=ask)
            await monitor.send(event | ({"call": seq} if kind != "topic" else {}))
            if dice.random() < 0.3:
                stream, kind = dice.choice(STREAMS[spec])
                await monitor.send(make_clock(stream, at, kind))
            await asyncio.sleep(0)
        await monitor.send(*(make_clock(stream, 10**4, kind) for stream, kind in STREAMS[spec]))
        await monitor.send(make_event(seq + 1, STREAMS[spec][0][0], 9999, data_of(dice)))

    async with (
        attached(server, "one", session=session, spec=spec) as one,
        attached(server, "two", session=session) as two,
    ):
        await asyncio.gather(speak("one", one), speak("two", two))
        await server.until(
            lambda: server.get(f"sessions/{session}")["counters"], lambda c: c["steps"] and not c["held"]
        )
        for monitor in (one, two):
            await monitor.send(make_event(500, STREAMS[spec][0][0], 0.5, data_of(dice)))  # late: all others were judged
            await monitor.send({"type": "detach"})
            while (await monitor.recv())["type"] != "detached":
                pass


def comparable(records: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Records without what a trace does not tell: of revisions not when they were said, behind all that is new."""
    untold = {"spec", "waited"}
    return [
        {k: v for k, v in record.items() if k not in (untold | {"judged"} if record["kind"] == "revision" else untold)}
        for record in records
    ]


@pytest.mark.parametrize("spec", STREAMS)
@pytest.mark.parametrize("form", ["jsonl", "mcap"])
async def test_the_replay_of_a_recording_is_the_session(
    server: Server, session: str, tmp_path: Path, spec: str, form: str
) -> None:
    await live(server, session, spec, random.Random(f"{spec} {form}"))
    told = server.records(session)
    assert any(r["late"] for r in told)
    assert any(r["degraded"] for r in told)
    out = tmp_path / f"session.{form}"
    ended = run("record", session, "-o", out, "--url", server.url)
    assert ended.returncode == 0, ended.stderr
    replayed = run("replay", spec_of(spec), out, "--json")
    assert replayed.returncode in (0, 1), replayed.stderr
    *records, last = map(json.loads, replayed.stdout.splitlines())
    assert comparable(records) == comparable(told)
    ticks = len({(r["order"], r["seq"]) for r in told if r["kind"] == "tick"})
    assert bool(ticks) is (spec == "deadline")
    assert f": {last['summary']['events'] + ticks} lines of {session}" in ended.stdout


async def test_a_trace_is_json_lines_in_order_of_arrival(server: Server, session: str) -> None:
    await live(server, session, "lamp", random.Random(0))
    response = server.http.get(f"/api/v1/sessions/{session}/trace")
    assert response.headers["content-type"].startswith("application/jsonl")
    lines = [json.loads(line) for line in response.text.splitlines()]
    assert [line["arrived"] for line in lines] == sorted(line["arrived"] for line in lines)
    judged = {(r["monitor"], r["seq"]) for r in server.records(session)}
    assert {(line["monitor"], line["seq"]) for line in lines} == judged


async def test_a_trace_can_be_ordered_anew(server: Server, session: str, tmp_path: Path) -> None:
    await live(server, session, "lamp", random.Random(1))
    out = tmp_path / "session.jsonl"
    assert run("record", session, "-o", out, "--url", server.url).returncode == 0
    ended = run("replay", spec_of("lamp"), out, "--by", "publication", "--json")
    *records, _ = map(json.loads, ended.stdout.splitlines())
    on_time = [r["stamp"] for r in records if not r["late"]]
    assert on_time == sorted(on_time)
    assert {(r["monitor"], r["seq"]) for r in records} == {(r["monitor"], r["seq"]) for r in server.records(session)}
    lines = out.read_text().splitlines()
    rest = [line for line in lines if all(place["position"] > 10 for place in json.loads(line)["places"])]
    out.write_text("\n".join(rest) + "\n")
    assert "begins with step 11," in failed("replay", spec_of("lamp"), out)
    assert run("replay", spec_of("lamp"), out, "--by", "arrival").returncode in (0, 1)


def test_what_can_not_be_recorded(server: Server, tmp_path: Path) -> None:
    assert "no session 'nothing'" in failed("record", "nothing", "-o", tmp_path / "x.mcap", "--url", server.url)
    assert "name it .mcap or .jsonl" in failed("record", "nothing", "-o", tmp_path / "x.bag", "--url", server.url)
    assert "can't be written" in failed("record", "x", "-o", tmp_path / "no" / "x.mcap", "--url", server.url)
    assert list(tmp_path.iterdir()) == []
    assert server.http.get("/api/v1/sessions/nothing/trace").status_code == 404


async def test_deadlines_that_ran_out_are_judged_again(server: Server, session: str, tmp_path: Path) -> None:
    async with attached(server, session=session, spec="timed") as monitor:
        await monitor.send(make_event(1, "/a", at=0), make_clock("/a", 60), make_clock("/b", 60))
        await monitor.violated(1)
        await monitor.send(make_event(2, "/b", at=70), make_clock("/a", 80))
        await monitor.acked(2)
    told, out = server.records(session), tmp_path / "session.jsonl"
    assert [r["kind"] for r in told if r["property"] == "answered"] == ["topic", "tick", "topic"]
    assert run("record", session, "-o", out, "--url", server.url).returncode == 0
    ended = run("replay", spec_of("timed"), out, "--json")
    *records, last = map(json.loads, ended.stdout.splitlines())
    assert comparable(records) == comparable(told)
    assert last["summary"]["events"] == 2
