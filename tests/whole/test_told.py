"""The number that fails, its step and its time are on every surface that people look at."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from oracle_adapter.violations import first_text, violation_text

from oracle_server.core.naming import moment
from tests.whole.client import BASE, attached, make_event
from tests.whole.harness import Server, run

SPEC = """
id: speed
ordering: {by: arrival}
streams:
  - topic: /cmd
    signals: {cmd: msg.v, percent: msg.percent}
properties:
  - {id: slow, formula: '{topic: "/cmd"} -> {cmd <= 1.0}'}
  - {id: full, formula: '{topic: "/cmd"} -> {percent >= 20}'}
"""
DATA: list[dict[str, Any]] = [{"v": 0.5, "percent": 30}, {"v": 1.4, "percent": 30}, {"v": 0.2}]
STAMPS = [BASE + n * 10**6 for n in (1, 2, 3)]
SLOW = f"cmd = 1.4, wanted <= 1.0, at step 2 ({moment(STAMPS[1])})"
FULL = f"`percent` is absent, at step 3 ({moment(STAMPS[2])})"


async def violated(server: Server, session: str) -> list[dict[str, Any]]:
    assert server.http.put("/api/v1/specs/speed", content=SPEC).is_success
    async with attached(server, session=session, spec="speed", verdicts=True) as monitor:
        await monitor.send(*(make_event(n, "/cmd", at=n, data=data) for n, data in enumerate(DATA, start=1)))
        found = await monitor.violated(2)
        await monitor.acked(3)
        return found


async def test_a_server_tells_it_to_monitors_in_its_state_its_log_and_on_the_command_line(
    server: Server, session: str
) -> None:
    slow, full = await violated(server, session)
    for record, said in ((slow, SLOW), (full, FULL)):
        assert said in record["explanation"]["text"]
        shown = violation_text(record)
        assert shown.startswith(f"violation: {record['property']} does not hold at step {record['step']} ")
        assert said in shown
        assert shown.endswith(f" (#{record['n']})")
        assert said in server.said(rf"violation: {record['property']} [^\n]*session={session}")[0]
    assert slow["explanation"]["reasons"][1]["failing"] == [{"signal": "cmd", "op": "<=", "wanted": 1.0, "value": 1.4}]
    states = {p["id"]: p for p in server.get(f"sessions/{session}")["properties"]}
    firsts = [(s["first_violation_step"], s["first_violation_at"]) for s in (states["slow"], states["full"])]
    assert firsts == [(2, STAMPS[1]), (3, STAMPS[2])]
    assert first_text(states["slow"]) == f"step 2, {moment(STAMPS[1])}"
    for options in ([], ["--explain", str(slow["n"])]):
        told = await asyncio.to_thread(run, "verdicts", session, "--url", server.url, *options)
        assert SLOW in told.stdout
        assert f"(#{slow['n']})" in told.stdout


async def test_a_restart_and_the_history_keep_where_it_was_first(server: Server, session: str) -> None:
    await violated(server, session)
    before = server.get(f"sessions/{session}")["properties"]
    server.http.delete(f"/api/v1/sessions/{session}")
    assert server.get(f"sessions/{session}")["properties"] == before


@pytest.mark.parametrize("form", ["text", "junit", "csv", "jsonl"])
def test_replay_tells_it(tmp_path: Path, form: str) -> None:
    spec, trace = tmp_path / "speed.yaml", tmp_path / "trace.jsonl"
    spec.write_text(SPEC)
    events = zip(STAMPS, DATA, strict=True)
    lines = [{"stream": "/cmd", "stamp": at, "arrived": at, "data": data} for at, data in events]
    trace.write_text("".join(json.dumps(line) + "\n" for line in lines))
    ended = run("replay", spec, trace, "--format", form)
    assert ended.returncode == 1
    if form == "junit":
        failures = ElementTree.fromstring(ended.stdout).iter("failure")
        first, second = [(each.get("message"), each.text or "") for each in failures]
        assert first[0] == f"violated once in 1 episode, first at step 2 ({moment(STAMPS[1])})"
        assert SLOW in first[1]
        assert FULL in second[1]
        return
    for said in (SLOW, FULL):
        assert said in ended.stdout
    if form == "text":
        assert f"step 2, {moment(STAMPS[1])}" in ended.stdout
        assert "verdict " not in ended.stdout
