"""What the command line reads of a running server, whatever a robot's texts hold."""

from __future__ import annotations

import json
from pathlib import Path

from tests.whole.client import attached, make_event
from tests.whole.conftest import copy_specs
from tests.whole.harness import Server, run

ENDS = "a\u2028b\u2029c\x85d\x0be\x1cf"
"""Characters that Python takes for ends of lines, and neither JSON nor Server-Sent Events do."""
SPEC = "id: odd\nstreams:\n  - {topic: /a, signals: {v: msg.v}}\nproperties:\n  - {id: p, formula: 'not {v: *}'}\n"


async def test_texts_with_ends_of_lines_in_them_are_followed_and_recorded_whole(tmp_path: Path) -> None:
    with Server(copy_specs(tmp_path / "specs"), tmp_path / "data") as server:
        assert server.http.put("/api/v1/specs/odd", content=SPEC).is_success
        async with attached(server, session="s", spec="odd") as monitor:
            await monitor.send(make_event(1, data={"v": ENDS}), make_event(2, at=1, data={"v": "plain"}))
            await monitor.detach()
        assert server.http.delete("/api/v1/sessions/s").is_success
        followed = run("verdicts", "s", "--follow", "--json", "--url", server.url)
        assert (followed.returncode, followed.stderr) == (0, "")
        told = [json.loads(line) for line in followed.stdout.split("\n") if line]
        assert told == server.records("s")
        trace = tmp_path / "s.jsonl"
        assert run("record", "s", "--output", trace, "--url", server.url).returncode == 0
        lines = [json.loads(line) for line in trace.read_bytes().split(b"\n") if line]
        assert [line["signals"]["v"] for line in lines] == [ENDS, "plain"]
