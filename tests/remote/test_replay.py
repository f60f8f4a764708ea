"""Recordings judged by oracles elsewhere, which are asked as in a live session."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from websockets.asyncio.client import connect

from tests.processes import reserved_port
from tests.remote.conftest import Director, Oracles, put, spec
from tests.whole.client import attached, make_event
from tests.whole.harness import PATIENCE, Server, failed, run


def replayed(*arguments: str | Path) -> tuple[int, list[dict[str, Any]], dict[str, Any]]:
    ended = run("replay", *arguments, "--json")
    assert ended.stderr == ""
    *lines, last = (json.loads(line) for line in ended.stdout.splitlines())
    return ended.returncode, [line for line in lines if "property" in line], last["summary"]


def test_a_recording_is_judged_by_the_oracle(tmp_path: Path, oracles: Oracles) -> None:
    (tmp_path / "x.yaml").write_text(spec("x", oracles.url("prolog")).replace("by: arrival", "by: publication"))
    log = tmp_path / "log.jsonl"
    lines = [{"topic": "a", "time": n, "v": v, "verdict": "true"} for n, v in ((1.5, 1), (2.5, 9), (3.5, 2))]
    log.write_text("".join(json.dumps(line) + "\n" for line in lines))
    status, records, summary = replayed(tmp_path / "x.yaml", log)
    theirs = [r for r in records if r["property"] == "theirs"]
    assert status == 1
    assert [r["outcome"] for r in theirs] == ["currently_true", "currently_false", "currently_false"]
    assert theirs[1]["explanation"]["text"].endswith("answered false")
    assert (summary["properties"]["theirs"]["violations"], summary["compared"], summary["differing"]) == (1, 3, 2)
    _, again, _ = replayed(tmp_path / "x.yaml", log, "--by", "both")
    assert [r["outcome"] for r in again if r["property"] == "theirs"] == [
        outcome for outcome in ("currently_true", "currently_false", "currently_false") for _ in range(2)
    ], "each order has a connection of its own"


def test_an_oracle_that_is_away_is_told_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "log.jsonl").write_text('{"topic": "a", "time": 1.5, "v": 1}\n')
    with reserved_port() as place:
        url = f"ws://127.0.0.1:{place.getsockname()[1]}/prolog"
        (tmp_path / "x.yaml").write_text(spec("x", url))
        said = failed("replay", tmp_path / "x.yaml", tmp_path / "log.jsonl")
    assert said.startswith(f"oracle-server: the oracle at {url} can't be reached: ")
    assert said.endswith("; start it first")


async def test_a_live_sessions_trace_gives_the_same_records_without_the_oracle(
    server: Server, director: Director, name: str, tmp_path: Path
) -> None:
    put(server, name, director.url)
    async with attached(server, session=name, spec=name) as monitor:
        for seq, reply in enumerate(("true", "violated", "hm", None, "true"), 1):
            await monitor.send(make_event(seq, "/go" if seq % 2 else "/a", data={"v": 7}, ask=seq == 1))
            connection, _ = await director.asked()
            await director.say(connection, reply)
            await monitor.acked(seq)
        await monitor.detach()
    trace = tmp_path / "trace.jsonl"
    assert run("record", name, "-o", trace, "--url", server.url).returncode == 0
    (tmp_path / "x.yaml").write_text(spec(name, director.url))
    _, records, _ = replayed(tmp_path / "x.yaml", trace)
    assert records == server.records(name)
    _, anew, _ = replayed(tmp_path / "x.yaml", trace, "--by", "arrival")
    assert {r["outcome"] for r in anew if r["property"] == "theirs"} == {"unknown"}
    async with connect(director.url, proxy=None, open_timeout=PATIENCE):
        assert await director.opened() == connection + 1, "nobody else has connected"
