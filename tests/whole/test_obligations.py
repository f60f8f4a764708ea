"""Obligations over HTTP and on the command line, after a restart, at the end, and in a replay of the trace."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

from tests.whole.client import attached, make_clock, make_event, stable
from tests.whole.conftest import SPECS, Starts
from tests.whole.harness import Server, run


def told(records: list[dict[str, Any]], name: str) -> list[Any]:
    """Of each record of a property: its outcome, what is open, and what was not answered."""
    found = [r for r in records if r["property"] == name]
    return [(r["outcome"], r["pending"], [each["values"] for each in r["about"]]) for r in found]


def pending(server: Server) -> list[int | None]:
    return [p["pending"] for p in server.get("sessions/s")["properties"]]


async def test_obligations_are_recorded_told_and_the_same_after_a_restart_and_in_a_replay(
    start: Starts, tmp_path: Path
) -> None:
    server = start()
    async with attached(server, session="s", spec="owing") as monitor:
        await monitor.send(make_event(1, at=0, data={"goal": "x"}), make_event(2, at=1_000, data={"goal": "y"}))
        await monitor.send(make_event(3, "/b", at=1_500, data={"done": "y"}))
        await monitor.send(make_clock("/a", 1_600), make_clock("/b", 1_600))
        await monitor.acked(3)
        assert pending(server) == [1, None, 2]
        assert server.stop() == 0

    server = start()
    async with attached(server, session="s") as monitor:
        await monitor.send(make_event(4, "/b", at=2_500), make_clock("/a", 3_000), make_clock("/b", 3_000))
        violation = await monitor.expect("violation")
        await monitor.acked(4)
    records = server.records("s")
    true, false = "currently_true", "currently_false"
    assert told(records, "answered") == [
        (true, 1, []), (true, 2, []), (true, 1, []), (false, 0, [{"g": "x"}]), (true, 0, []),
    ]  # fmt: skip
    assert {(r["pending"], r["about_count"]) for r in records if r["property"] == "past"} == {(None, 0)}
    assert (violation["kind"], violation["property"], violation["about_count"]) == ("tick", "answered", 1)
    (about,) = violation["about"]
    assert (about["step"], about["stream"], about["seq"], about["signals"]["goal"]) == (1, "/a", 1, "x")
    assert server.get("sessions/s/violations")["items"][0]["about"] == [about]
    explained = server.get(f"sessions/s/verdicts/{violation['n']}/explanation")
    assert explained["explanation"]["text"] == violation["explanation"]["text"]
    assert "at none of 3 steps until" in explained["explanation"]["text"]
    assert pending(server) == [0, None, 2]
    head, *rows = run("verdicts", "s", "--property", "answered", "--url", server.url).stdout.splitlines()
    assert head.split()[-2:] == ["pending", "n"]
    assert [row.split()[-2] for row in rows] == ["1", "2", "1", "0", "0"]

    server.http.delete("/api/v1/sessions/s").raise_for_status()
    after = server.records("s")
    assert after[: len(records)] == records
    assert told(after, "ever")[-1] == (false, 0, [{}, {}])
    assert server.get("sessions/s")["properties"][2]["violations"] == 2

    trace = tmp_path / "trace.jsonl"
    trace.write_text(server.http.get("/api/v1/sessions/s/trace").text)
    spec = next(folder / "owing.yaml" for folder in SPECS if (folder / "owing.yaml").exists())
    *replayed, _ = map(json.loads, run("replay", spec, trace, "--json").stdout.splitlines())
    assert stable(replayed) == stable(after)
    cells = list(csv.DictReader(io.StringIO(run("replay", spec, trace, "--format", "csv").stdout)))
    assert [row["about_count"] for row in cells] == [str(r["about_count"]) for r in after]
    assert "when the session ended" in run("replay", spec, trace).stdout
