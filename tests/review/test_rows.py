"""Events with rows in sessions: kept whole or not at all, restored as they were, and replayed from their trace."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from oracle_server.core.errors import TraceError
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.port import History
from oracle_server.history.query import Query
from oracle_server.history.records import StoredStep
from oracle_server.history.sqlite.history import SqliteHistory
from oracle_server.review.trace import trace_lines
from tests.history.making import find
from tests.processes import PATIENCE
from tests.replay.judging import judge, write_spec
from tests.review.test_restore import TIMES, Served
from tests.sessions.making import Standing, event

CHANGING = TIMES | {"waited", "released"}
"""What goes by when an event came: those that are sent again come together."""
SPEC = """
id: spec
ordering: {by: BY, max_delay: none, late: LATE}
streams:
  - topic: /tf
    each: msg.transforms
    signals: {child: item.child, n: index, x: item.x}
  - topic: /b
    signals: {x: msg.x}
properties:
  - id: once_each
    formula: 'forall[c]. {child: *c} -> not pre {child: *c, x: 3}'
  - id: b_before
    formula: '{topic: "/tf", x: 2} -> once {topic: "/b"}'
"""
SENT: list[tuple[int, str, Any, int]] = [
    (1, "/tf", [("a", 1), ("b", 2), ("c", 3)], 1), (2, "/b", 5, 1), (4, "/tf", [], 2), (5, "/tf", [("c", 2)], 4),
    (6, "/b", 5, 3), (7, "/tf", [("a", 2), ("a", 3), ("a", 1)], 6), (8, "/tf", [("c", 3), ("c", 3)], 1),
]  # fmt: skip


async def send(made: Served, seq: int, stream: str, what: Any, stamp: int) -> None:
    items = [{"child": child, "x": x} for child, x in what] if stream == "/tf" else None
    message = event(seq, stream, **({"x": what} if items is None else {"transforms": items}))
    made.live.ingest(made.monitor, message.model_copy(update={"stamp": stamp * 10**9}))
    await made.commit()


async def judged(folder: Path, by: str, late: str, history: History, *, restarted: bool, saved: bool) -> Any:
    """What comes of some events, with a server that ends after each of them, or goes on."""
    folder.mkdir()
    clock = Standing()  # what waits for others that are late waits until the close, and no ended server goes on with it
    made = Served(folder, by, SPEC.replace("LATE", late), history, clock)
    await made.begin()
    for i, one in enumerate(SENT):
        await send(made, *one)
        if saved:
            made.live.ledger.save()
            await made.history.flush()
        if restarted:
            await made.begin()
            for again in SENT[: i + 1]:  # an adapter sends again what was not acked
                await send(made, *again)
    assert await made.sessions.closed_within(made.live, PATIENCE)
    found, _ = await find(history, made.live.record, Query(limit=1000))
    lines = [line async for page in trace_lines(history, made.live.number) for line in page]
    records = [{name: value for name, value in r.items() if name not in CHANGING} for r in found]
    return records, made.monitor.numbering.upto, lines


def history_in(kind: str, folder: Path) -> History:
    folder.mkdir()
    return MemoryHistory() if kind == "memory" else SqliteHistory(folder)


@pytest.mark.parametrize("kind", ["memory", "sqlite"])
@pytest.mark.parametrize("saved", [False, True])
@pytest.mark.parametrize(
    ("by", "late"), [("arrival", "judge"), ("publication", "skip"), ("publication", "revise"), ("both", "judge")]
)
async def test_a_server_that_ends_after_each_event_judges_as_one_that_goes_on(
    tmp_path: Path, by: str, late: str, kind: str, *, saved: bool
) -> None:
    async with asyncio.timeout(PATIENCE):
        plain = await judged(
            tmp_path / "plain", by, late, history_in(kind, tmp_path / "h1"), restarted=False, saved=False
        )
        again = await judged(
            tmp_path / "restarted", by, late, history_in(kind, tmp_path / "h2"), restarted=True, saved=saved
        )
        assert again[:2] == plain[:2]
        rows = [(r["seq"], r["row"]) for r in plain[0] if "row" in r and r["property"] == "b_before"]
        assert sorted(set(rows)) == [(1, 0), (1, 1), (1, 2), (5, 0), (7, 0), (7, 1), (7, 2), (8, 0), (8, 1)]


@pytest.mark.parametrize(
    ("by", "late"), [("arrival", "judge"), ("publication", "skip"), ("publication", "revise"), ("both", "judge")]
)
async def test_a_trace_has_each_row_once_and_is_judged_as_the_session_was(tmp_path: Path, by: str, late: str) -> None:
    records, _, lines = await judged(tmp_path / "live", by, late, MemoryHistory(), restarted=False, saved=False)
    found = [(line["monitor"], line["seq"], line.get("row")) for line in lines]
    assert len(found) == len(set(found)) == 12
    path = tmp_path / "own.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    again = judge(write_spec(tmp_path, SPEC.replace("LATE", late).replace("BY", by)), path)
    assert again.summary["events"] == len(SENT)
    names = ("n", "order", "property", "outcome", "seq", "row", "late", "degraded")
    assert [[row.get(name) for name in names] for row in again.rows] == [
        [record.get(name) for name in names] for record in records
    ]


async def test_a_trace_whose_first_event_lacks_an_order_is_refused_in_words(tmp_path: Path) -> None:
    _, _, lines = await judged(tmp_path / "live", "both", "judge", MemoryHistory(), restarted=False, saved=False)
    lines[0]["places"] = [place for place in lines[0]["places"] if place["order"] == "arrival"]
    path = tmp_path / "own.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    with pytest.raises(TraceError, match=r"judged by arrival alone, and others by publication: .* use --by"):
        judge(write_spec(tmp_path, SPEC.replace("LATE", "judge").replace("BY", "both")), path)


@pytest.mark.parametrize("by", ["arrival", "both"])
async def test_a_trace_that_lacks_steps_in_its_midst_is_refused_in_words(tmp_path: Path, by: str) -> None:
    """A robot that was full before its centre was there again has let go of some."""
    _, _, lines = await judged(tmp_path / "live", by, "judge", MemoryHistory(), restarted=False, saved=False)
    path = tmp_path / "own.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in [*lines[:3], *lines[5:]]))
    with pytest.raises(TraceError, match=r"steps from \d+ to before \d+ of the session are not .* use --by"):
        judge(write_spec(tmp_path, SPEC.replace("LATE", "judge").replace("BY", by)), path)


async def test_a_trace_is_judged_by_a_spec_that_observes_fewer_streams(tmp_path: Path) -> None:
    _, _, lines = await judged(tmp_path / "live", "arrival", "judge", MemoryHistory(), restarted=False, saved=False)
    path = tmp_path / "own.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    fewer = "id: spec\nstreams: [{topic: /b, signals: {x: msg.x}}]\nproperties: [{id: five, formula: '{x: 5}'}]\n"
    again = judge(write_spec(tmp_path, fewer), path)
    assert [(row["seq"], row["outcome"]) for row in again.rows] == [(2, "currently_true"), (6, "currently_true")]


async def test_no_part_of_an_event_is_kept_while_its_other_rows_wait(tmp_path: Path) -> None:
    """A restart would take the event for judged, and the other rows would be lost."""
    async with asyncio.timeout(PATIENCE):
        made = Served(tmp_path, "arrival", SPEC.replace("LATE", "judge"))
        await made.begin()
        made.live.core.divide(lambda: True)
        kept: list[int] = []
        append = made.history.append

        def counted(session: int, steps: Sequence[StoredStep], *more: Any) -> None:
            kept.append(len(steps))
            append(session, steps, *more)

        made.history.append = counted  # type: ignore[method-assign, assignment]
        items = [{"child": child, "x": 1} for child in "abc"]
        made.live.ingest(made.monitor, event(1, "/tf", transforms=items).model_copy(update={"stamp": 10**9}))
        made.live.ledger.save()
        assert kept == []
        await made.live.caught_up()
        await made.commit()
        assert kept == [3]
        assert made.monitor.numbering.upto == 1
