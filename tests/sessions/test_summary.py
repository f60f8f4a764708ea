"""What a page is told of a session: what has changed, row by row, and never more than it is to get."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path

import pytest

from oracle_server.api import summaries as summaries_module
from oracle_server.api.summaries import summaries
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.records import Document
from oracle_server.sessions.status import session_state
from oracle_server.sessions.summary import brief, changed, summary
from oracle_server.wire.incoming import ReportMessage
from oracle_server.wire.json import encode
from tests.processes import PATIENCE
from tests.sessions.making import GUARD, Kept, attach, event, registry


async def test_nothing_is_told_where_nothing_but_time_has_gone_on(tmp_path: Path) -> None:
    sessions = registry(MemoryHistory(), tmp_path, GUARD)
    live, monitor = await sessions.attach(attach("s", "guard"), Kept())
    live.ingest(monitor, event(1, speed=1))
    before = summary(session_state(live, live.clock.now()))
    later = summary(session_state(live, live.clock.now() + 10**9))
    assert changed(before, later) == {}
    live.ingest(monitor, event(2, speed=9))
    news = changed(before, summary(session_state(live, live.clock.now())))
    assert [(row["id"], row["violations"]) for row in news["properties"]] == [("slow", 1)]
    assert not {"id", "spec", "opened", "hold"} & news.keys()


def test_rows_that_have_not_changed_are_left_out() -> None:
    rows = [{"id": f"p{i}", "order": order, "violations": 0} for i in range(3) for order in ("publication", "arrival")]
    before = {"properties": rows, "streams": [], "monitors": []}
    now = {**before, "properties": [*rows[:3], {**rows[3], "violations": 1}, *rows[4:]]}
    assert changed(before, now) == {"properties": [now["properties"][3]]}
    assert changed({}, now) == now, "all at first"


async def test_rows_that_are_not_there_any_more_are_told(tmp_path: Path) -> None:
    sessions = registry(MemoryHistory(), tmp_path, GUARD)
    live, monitor = await sessions.attach(attach("s", "guard"), Kept())
    live.ingest(monitor, event(1, speed=1))
    before = summary(session_state(live, live.clock.now()))
    ((name, stream, kind),) = [(row["monitor"], row["stream"], row["kind"]) for row in before["streams"]]
    live.detach(monitor)
    after = summary(session_state(live, live.clock.now()))
    assert after["streams"] == []
    assert changed(before, after)["gone"] == {"streams": [{"monitor": name, "stream": stream, "kind": kind}]}


async def test_what_has_changed_is_found_beside_the_event_loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    history = MemoryHistory()
    sessions = registry(history, tmp_path, GUARD)
    await sessions.attach(attach("s", "guard"), Kept())
    found: list[threading.Thread] = []

    def noted(sent: Document, state: Document) -> Document:
        found.append(threading.current_thread())
        return changed(sent, state)

    monkeypatch.setattr(summaries_module, "changed", noted)
    assert (await anext(summaries(sessions, history, "s"))).startswith(b"event: summary")
    assert len(found) == 1
    assert found[0] is not threading.current_thread()


async def test_who_was_told_much_is_told_the_next_later(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    history = MemoryHistory()
    sessions = registry(history, tmp_path, GUARD)
    live, _ = await sessions.attach(attach("s", "guard"), Kept())
    waits: list[float] = []

    async def rest(seconds: float) -> None:
        waits.append(seconds)
        live.ledger.commits.end()  # as where the server stops

    monkeypatch.setattr(summaries_module, "_RATE", 100)
    monkeypatch.setattr(asyncio, "sleep", rest)
    told = summaries(sessions, history, "s")
    sizes = [len(await anext(told))]
    assert [text async for text in told] == []
    assert waits == [sizes[0] / 100]
    assert waits[0] > 1, "and not every half second"


async def test_a_list_has_the_worst_of_each_session_in_brief(tmp_path: Path) -> None:
    sessions = registry(MemoryHistory(), tmp_path, GUARD)
    live, monitor = await sessions.attach(attach("s", "guard"), Kept())
    for seq, speed in enumerate((1, 9, 1), start=1):
        live.ingest(monitor, event(seq, speed=speed))
    await sessions.create("guard", "t")
    (stream,) = monitor.streams
    told = {"stream": stream.name, "kind": stream.kind, "trouble": "is of another type"}
    live.report(monitor, ReportMessage.model_validate({"type": "report", "streams": [told]}))
    first, second = (brief(state) for state in reversed(await sessions.states()))
    assert (first["caveats"], second["caveats"]) == ([f"{stream.name}: is of another type"], [])
    assert (first["id"], first["live"], first["steps"], first["violations"]) == ("s", True, 3, 1)
    assert (first["outcome"], first["connected"], first["monitors"]) == ("currently_true", 1, 1)
    assert (second["id"], second["outcome"], second["connected"], second["monitors"]) == ("t", "unknown", 0, 0)
    assert await sessions.end("s", PATIENCE)
    old = await sessions.state("s") or {}
    for key in ("kind", "run", "live", "idle", "without_monitor_since", "closed_because"):
        del old[key]  # as an older version kept it
    assert (brief(old)["status"], brief(old)["live"]) == ("closed", None)
    assert len(encode(brief(old))) < len(encode(old)) / 2
