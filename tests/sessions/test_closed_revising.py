"""A session that revises is closed: what is final is told of it in all that is asked, and in a replay of its trace."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest

from oracle_server.history.episodes import EpisodeQuery
from oracle_server.history.port import History
from oracle_server.history.query import Query
from oracle_server.replay.command import run_replay
from oracle_server.review.explanation import explained
from oracle_server.review.restore import restore
from oracle_server.review.trace import trace_lines
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.registry import Registry
from tests.history.backends import BACKENDS, Make
from tests.history.making import find
from tests.processes import PATIENCE
from tests.sessions.making import Kept, attach, event, registry

SPEC = """
id: spec
ordering: {late: revise, horizon: 60s}
streams:
  - topic: /a
    signals: {v: msg.v}
properties:
  - id: never_large
    formula: 'historically not {v > 5}'
  - id: small
    formula: 'not {v > 2}'
"""


async def closed(sessions: Registry) -> LiveSession:
    """A session of three events, the second of which breaks a property for good."""
    live, monitor = await sessions.attach(attach("s", "spec"), Kept())
    now = live.clock.now()
    for seq, v in enumerate((1, 7, 1), 1):
        message = event(seq, "/a", v=v).model_copy(update={"stamp": now - 10**6 + seq})
        live.ingest(monitor, message)
    async with asyncio.timeout(PATIENCE):
        assert await sessions.closed_within(live, PATIENCE)
    return live


@pytest.mark.parametrize("backend", BACKENDS)
async def test_what_is_final_is_told_to_be_wherever_it_is_asked(
    tmp_path: Path, make: Make, backend: str, capsys: pytest.CaptureFixture[str]
) -> None:
    history = make(backend)
    sessions = registry(history, tmp_path / "specs", SPEC)
    await closed(sessions)
    state = await sessions.state("s")
    assert state is not None
    never_large, small = state["properties"]
    assert (never_large["outcome"], never_large["violations"], small["outcome"]) == ("false", 1, "currently_true")
    known = await history.session(1)
    assert known is not None
    records, _ = await find(history, known, Query())
    said = [(r["kind"], r["outcome"], r["violation"]) for r in records if r["property"] == "never_large"]
    assert said == [
        ("topic", "currently_true", False),
        ("topic", "currently_false", True),
        ("topic", "currently_false", False),
        ("tick", "false", False),
    ]
    page, _ = await history.episodes(EpisodeQuery(session=1))
    episodes = [(e["property"], e["first"], e["last"], e["open"], e["final"]) for e in page]
    assert episodes == [("never_large", 3, 7, False, True), ("small", 4, 4, False, False)]
    record = await explained(history, 1, 7)
    assert record is not None
    assert record["explanation"] is not None
    assert record["explanation"]["text"].startswith("never_large does not hold when the session ended at ")
    assert "did not hold at step 2 " in record["explanation"]["text"]
    record = await explained(history, 1, 8)
    assert record is not None
    assert record["explanation"] is not None
    assert record["explanation"]["text"].startswith("small holds when the session ended at ")
    await replayed(history, tmp_path, capsys)
    await asyncio.to_thread(history.close)


async def replayed(history: History, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its trace, judged again as it was, and put in order anew, ends as the session did."""
    (folder / "spec.yaml").write_text(SPEC)
    known = await history.session(1)
    assert known is not None
    trace = folder / "trace.jsonl"
    lines = [line async for page in trace_lines(history, 1) for line in page]
    trace.write_text("".join(json.dumps(line) + "\n" for line in lines))
    capsys.readouterr()
    for by in (None, "publication"):
        run_replay([folder / "spec.yaml"], trace, by, "jsonl")
        *records, last = map(json.loads, capsys.readouterr().out.splitlines())
        assert [r["outcome"] for r in records if r["property"] == "never_large"] == [
            "currently_true", "currently_false", "currently_false", "false",
        ]  # fmt: skip
        assert records[-2]["n"] == 7
        assert last["summary"]["properties"]["never_large"]["outcome"] == "false"


async def test_a_session_that_was_not_closed_after_all_stands_as_it_said(tmp_path: Path, make: Make) -> None:
    history = make("memory")
    sessions = registry(history, tmp_path / "specs", SPEC)
    live = await closed(sessions)
    restored = await restore(history, 1, live.core.plan)
    (one,), (other,) = live.core.judges.values(), restored.core.judges.values()
    assert [s.outcome for s in other.properties] == [s.outcome for s in one.properties]
    assert (other.following, other.counters) == (one.following, one.counters)
    assert restored.core.end(live.clock.now()) == []
    await asyncio.to_thread(history.close)
