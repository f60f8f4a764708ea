"""Robustness in the history, in violations, after a restart, and in the replay of a session's trace."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

from tests.whole.client import attached, make_clock, make_event, stable
from tests.whole.conftest import SPECS, Starts
from tests.whole.harness import run

VALUES = [1.5, "NaN", 4, 3, 0.1]
"""What /a says every 8 ms; /b speaks in between."""


def measured(records: list[dict[str, Any]], name: str) -> list[tuple[str, Any]]:
    return [(r["outcome"], r["robustness"]) for r in records if r["property"] == name]


def assert_shown(url: str) -> None:
    """The tables have a column for it where there is any."""
    summary = run("verdicts", "s", "--url", url).stdout.splitlines()
    assert [line.split()[:3] for line in summary[:4]] == [
        ["property", "outcome", "robustness"],
        ["small", "unknown", "0"],
        ["recent", "currently_true", "2"],
        ["told", "true", "-"],
    ]
    head, first = next(
        (summary[place], summary[place + 1]) for place, line in enumerate(summary) if line.startswith("step ")
    )
    assert head.split()[-2:] == ["robustness", "n"]
    assert "-1" in first.split()
    head, first, *_ = run("verdicts", "s", "--property", "recent", "--url", url).stdout.splitlines()
    assert (head.split()[-2], first.split()[-2]) == ("robustness", "0.5")
    assert "robustness" not in run("verdicts", "s", "--property", "told", "--url", url).stdout


async def test_robustness_is_recorded_told_and_the_same_after_a_restart_and_in_a_replay(
    start: Starts, tmp_path: Path
) -> None:
    server = start()
    async with attached(server, session="s", spec="robust") as monitor:
        for i, v in enumerate(VALUES):
            await monitor.send(make_event(2 * i + 1, at=8 * i, data={"v": v}))
            await monitor.send(make_event(2 * i + 2, "/b", at=8 * i + 4))
        await monitor.send(make_clock("/a", 1_000), make_clock("/b", 1_000))
        violation = await monitor.expect("violation")
        await monitor.acked(10)
    records = server.records("s")
    true, false, unknown = "currently_true", "currently_false", "unknown"
    assert measured(records, "small") == [
        (true, 1.5), (true, 1.5), (unknown, None), (unknown, None), (false, -1),
        (false, -1), (false, -1), (false, -1), (unknown, 0), (unknown, 0),
    ]  # fmt: skip
    assert measured(records, "recent") == [
        (true, 0.5), (true, 0.5), (unknown, None), (unknown, None), (true, 3),
        (true, 3), (true, 3), (true, 3), (true, 2), (true, 2),
    ]  # fmt: skip
    assert {r["robustness"] for r in records if r["property"] == "told"} == {None}
    explained = server.get(f"sessions/s/verdicts/{violation['n']}/explanation")
    assert explained["explanation"]["reasons"][0]["text"] == "robustness -1"
    shown = run("verdicts", "s", "--explain", str(violation["n"]), "--url", server.url)
    assert (shown.returncode, ["robustness", "-1"] in [line.split()[-2:] for line in shown.stdout.splitlines()]) == (
        0,
        True,
    )
    assert (violation["property"], violation["robustness"]) == ("small", -1)
    assert violation["explanation"]["values"] == {"v": 4}
    assert server.get("sessions/s")["properties"][1]["robustness"] == 2
    assert_shown(server.url)
    assert server.stop() == 0

    server = start()
    async with attached(server, session="s") as monitor:
        await monitor.send(make_event(11, at=50, data={"v": 2}), make_clock("/a", 2_000), make_clock("/b", 2_000))
        await monitor.acked(11)
    after = server.records("s")
    assert after[: len(records)] == records
    assert measured(after, "small")[-1] == (true, 1)

    trace = tmp_path / "trace.jsonl"
    trace.write_text(server.http.get("/api/v1/sessions/s/trace").text)
    spec = next(folder / "robust.yaml" for folder in SPECS if (folder / "robust.yaml").exists())
    *replayed, _ = map(json.loads, run("replay", spec, trace, "--json").stdout.splitlines())
    assert stable(replayed) == stable(after)
    rows = list(csv.DictReader(io.StringIO(run("replay", spec, trace, "--format", "csv").stdout)))
    assert [row["robustness"] for row in rows] == [
        "" if r["robustness"] is None else str(r["robustness"]) for r in after
    ]
    assert "robustness -1" in run("replay", spec, trace).stdout
    assert "robustness -1" in run("replay", spec, trace, "--format", "junit").stdout
