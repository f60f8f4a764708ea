"""A recorded trace, sent by a monitor as it happens, is judged as `replay` judges it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.whole.client import attached, make_events, stable
from tests.whole.harness import Server, run

ROOT = Path(__file__).parents[2]
TRACES = ROOT / "examples" / "battery_uav" / "traces"


@pytest.mark.parametrize("trace", ["shuffled", "fault_request_without_change"])
async def test_live_and_replayed_verdicts_are_the_same(
    server: Server, session: str, tmp_path: Path, trace: str
) -> None:
    spec_id = f"uav-{trace}"
    text = (ROOT / "specs" / "battery_uav.yaml").read_text()
    text = text.replace("id: battery_uav\n", f"id: {spec_id}\n")
    text = text.replace("max_delay: 200ms", "max_delay: 1h")
    text = text.replace("    action: filter\n", "    action: filter\n    decide_within: 2h\n")
    spec = tmp_path / "spec.yaml"
    spec.write_text(text)
    replayed = run("replay", spec, TRACES / f"{trace}.jsonl", "--json")
    *records, _ = map(json.loads, replayed.stdout.splitlines())

    assert server.http.put(f"/api/v1/specs/{spec_id}", content=text).is_success
    lines: list[dict[str, Any]] = [json.loads(line) for line in (TRACES / f"{trace}.jsonl").read_text().splitlines()]
    events = [{k: v for k, v in line.items() if k not in ("monitor", "arrived")} for line in lines]
    async with attached(server, "uav1", session=session, spec=spec_id) as monitor:
        for start in range(0, len(events), 50):
            batch = [event | {"seq": seq} for seq, event in enumerate(events[start : start + 50], start=start + 1)]
            await monitor.send(make_events(*batch))
        await monitor.detach()
    said, again = stable(server.records(session)), stable(records)
    assert said == again
