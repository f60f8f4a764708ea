"""The parts of formulas by time: never what contradicts the verdicts that were recorded.

    CASES=5000 pytest tests/review/test_parts.py

is the long run. A case is told by its number alone.
"""

from __future__ import annotations

import asyncio
import json
import os
import random
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import pytest

from oracle_server.core.errors import SpecError
from oracle_server.core.events import Event, StreamKey
from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Formula
from oracle_server.core.plan import Plan, plan
from oracle_server.core.revisions import Revision
from oracle_server.core.session import Session
from oracle_server.core.verdicts import Judged
from oracle_server.engines.table import make_engines
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.records import SessionRecord, SnapshotRecord, StoredStep, stored, stored_revision
from oracle_server.history.views import said
from oracle_server.review.again import NoExplanationError
from oracle_server.review.parts import Around, PartRecord, PartsRecord, parts
from oracle_server.specfiles.load import parse_spec
from tests import generate
from tests.brute import truths
from tests.engines.test_against_brute import SEED
from tests.engines.test_obligations_random import formula as awaiting
from tests.strategies import SECOND

CASES = int(os.environ.get("CASES", "100"))
HOUR = 3600 * SECOND
HOLDS = {"true": "holds", "currently_true": "holds", "false": "fails", "currently_false": "fails", "unknown": "unknown"}


def unrolled(runs: list[Any], size: int) -> list[Any]:
    """What each step has."""
    starts = [*[start for start, _ in runs], size]
    return [value for (_, value), (a, b) in zip(runs, pairwise(starts), strict=True) for _ in range(b - a)]


class Judging:
    """A session that is judged, and what is kept of it."""

    def __init__(self, text: str) -> None:
        self.plan: Plan = plan(parse_spec(text, "spec", bounded=False).spec)
        properties = tuple(p.id for p in self.plan.spec.properties)
        self.record = SessionRecord(1, "s", "spec", text, "", properties, False, 0)
        self.core = Session(self.plan, make_engines(self.plan))
        self.kept: list[StoredStep] = []
        self.revisions: list[Revision] = []
        self.snapshot: SnapshotRecord | None = None
        self.sent = 0

    def keep(self, judged: list[Judged]) -> None:
        for each in judged:
            position = len(self.kept) + 1
            if isinstance(each, Revision):
                self.revisions.append(each)
                self.kept.append(stored_revision(position, each))
            else:
                self.kept.append(stored(position, 0, each))

    def send(self, at: int, data: object, *, ask: bool = False, stream: str = "/s", late: int = 0) -> None:
        now, self.sent = max(at + late, self.core.now), self.sent + 1
        self.keep(self.core.ingest(Event(StreamKey(stream, "topic"), "m", self.sent, at, now, data, ask=ask)))

    def save(self) -> None:
        data = self.core.snapshot()
        if data is not None:
            position = data["revising"]["position"] if "revising" in data else len(self.kept)
            self.snapshot = SnapshotRecord(position, json.loads(json.dumps(data)))

    async def history(self) -> MemoryHistory:
        """A history of it."""
        history = MemoryHistory()
        history.start(asyncio.get_running_loop())
        history.open_session(self.record._replace(begun=self.core.begun))
        history.append(1, self.kept, lambda: None, self.revisions)
        if self.snapshot is not None and self.snapshot.position:
            history.save_snapshot(1, self.snapshot)
        await history.flush()
        return history


async def told(history: MemoryHistory, n: int, within: int = HOUR, steps: int = 500) -> PartsRecord:
    record = await history.session(1)
    assert record is not None
    found = await parts(history, record, Around(n, within, steps))
    assert found is not None
    return found


def check_whole(judging: Judging, found: PartsRecord, index: int) -> None:
    """The whole is what was recorded at each step, and what is Boolean is never otherwise than its parts."""
    width, size = len(judging.record.properties), len(found["times"])
    rows = [unrolled(part["runs"], size) for part in found["parts"]]
    recorded = [judging.kept[(n - 1) // width].outcomes[index].value for n in found["numbers"]]
    assert unrolled(found["outcomes"], size) == recorded
    assert rows[0] == [HOLDS[outcome] for outcome in recorded]
    for place, part in enumerate(found["parts"]):
        below = [rows[i] for i, other in enumerate(found["parts"]) if is_child(part, other, found["parts"])]
        if part["head"] == "not" and not part["more"]:
            for one, other in zip(rows[place], below[0], strict=True):
                assert {one, other} in ({"holds", "fails"}, {"unknown"}, {"not_told"}, {one, "not_told"})
        if part["head"] == "and" and not part["more"]:
            for one, *others in zip(rows[place], *below, strict=True):
                assert one != "holds" or "fails" not in others
                assert one != "fails" or {*others} != {"holds"}


def is_child(part: PartRecord, other: PartRecord, every: list[PartRecord]) -> bool:
    below = other["depth"] == part["depth"] + 1 and other["path"][: len(part["path"])] == part["path"]
    return below and every.index(other) > every.index(part)


def past_spec(formula: Formula, time: Time) -> str:
    return (
        f"id: spec\nordering: {{max_delay: none}}\nstreams: [{{topic: /s}}]\nproperties:\n"
        f"  - {{id: p, time: {time}, formula: {json.dumps(render(formula, time))}}}\n"
    )


@pytest.mark.parametrize("time", ["steps", "seconds"])
async def test_each_part_is_as_the_table_says_at_each_step(time: Time) -> None:
    compared = 0
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"parts {time} {number}")
        formula = generate.formula(rng, time, rng.randint(2, 4))
        try:
            judging = Judging(past_spec(formula, time))
        except SpecError:
            continue  # it is refused for what can't be
        trace = generate.trace(rng, rng.randint(3, 14))
        for i, (at, signals) in enumerate(trace):
            judging.send(at, dict(signals))
            if i == len(trace) // 3:
                judging.save()
        steps = [
            (s.step.stamp, {**s.step.signals, "kind": "topic", "topic": "/s"}) for s in judging.kept if not s.is_tick
        ]
        found = await told(await judging.history(), rng.randint(1, len(judging.kept)))
        check_whole(judging, found, 0)
        read = judging.plan.spec.properties[0].formula
        for part in found["parts"]:
            if part["needs"]:
                assert [value for _, value in part["runs"]] in ([], ["not_told"])
                continue
            known = unrolled(part["runs"], len(found["times"]))
            table = truths(at_path(read, part["path"]), steps, time)
            ticks = [judging.kept[n - 1].is_tick for n in found["numbers"]]
            mine = [value for value, tick in zip(known, ticks, strict=True) if not tick]
            assert len(mine) == len(table)
            for value, wanted in zip(mine, table, strict=True):
                assert value in ("holds" if wanted else "fails", "unknown", "not_told")
                compared += value not in ("unknown", "not_told")
    assert compared > CASES // 2


def at_path(formula: Formula, path: list[int]) -> Formula:
    for place in path:
        formula = tree.children(formula)[place]
    return formula


MIXED = """
id: spec
ordering: {{max_delay: none, by: {by}}}
streams:
  - {{topic: /s, action: filter, on_deny: undo}}
  - {{topic: /h, hold: [h], signals: {{h: 'msg.h'}}}}
derive:
  many: {{count: '{{topic: /s}}', over: 2s}}
properties:
  - {{id: past, time: seconds, formula: {past}}}
  - {{id: awaited, time: {time}, formula: {awaited}, at_end: violated}}
  - {{id: guard, formula: 'not {{topic: /s, a: 7}} or once[:2] {{h: *}}', guards: [/s], blame: caused}}
  - {{id: derived, time: seconds, formula: 'not {{many > 2}} and historically[:3s] not {{h: 2}}', latch: {latch}}}
"""


def mixed(rng: random.Random) -> str:
    time: Time = rng.choice(("steps", "seconds"))
    past, waits = generate.formula(rng, "seconds", rng.randint(1, 3)), awaiting(rng, time)
    return MIXED.format(
        by=rng.choice(("publication", "both")),
        past=json.dumps(render(past, "seconds")),
        time=time,
        awaited=json.dumps(render(waits, time)),
        latch=rng.choice(("true", "false")),
    )


async def test_the_whole_is_the_verdict_with_deadlines_denials_failures_and_obligations() -> None:
    compared = judged = 0
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"mixed {number}")
        try:
            judging = Judging(mixed(rng))
        except SpecError:
            continue  # it is refused for what can't be
        judged += 1
        for at, signals in generate.trace(rng, rng.randint(6, 20)):
            if rng.random() < 0.3:
                judging.send(at, {"h": rng.choice((1, 2, [3]))}, stream="/h")
            else:
                judging.send(at, dict(signals), ask=rng.random() < 0.6)
            if rng.random() < 0.1:
                judging.save()
            if rng.random() < 0.3:
                judging.keep(judging.core.advance(judging.core.now + rng.randint(0, 4 * SECOND)))
        judging.keep(judging.core.finish(judging.core.now))
        judging.keep(judging.core.end(judging.core.now))
        history, width = await judging.history(), 4
        for index in range(width):
            step = rng.choice(judging.kept)
            n = (step.position - 1) * width + index + 1
            found = await told(history, n, steps=rng.choice((3, 500)))
            check_whole(judging, found, index)
            assert step.is_tick or found["numbers"][found["at"]] == n
            compared += sum(value in ("holds", "fails") for part in found["parts"][1:] for _, value in part["runs"])
    assert compared > judged > CASES // 10


async def test_what_is_kept_is_judged_again_from_the_snapshot_alone() -> None:
    judging = Judging(past_spec(parse_formula("once[:3] {a: 7} or pre {a: 8}"), "steps"))
    for i in range(30):
        judging.send(i, {"a": i % 10})
        if i == 11:
            judging.save()
    whole = await told(await judging.history(), 20)
    history = await judging.history()
    await history.forget_steps(1, 9)
    kept = await told(history, 20)
    assert kept["numbers"] == [*range(13, 31)]
    for part, other in zip(kept["parts"], whole["parts"], strict=True):
        assert unrolled(part["runs"], 18) == unrolled(other["runs"], 30)[12:]
        assert unrolled(part["values"] or [[0, None]], 18) == unrolled(other["values"] or [[0, None]], 30)[12:]
    with pytest.raises(NoExplanationError, match="not kept any more"):
        await told(history, 10)


REVISING = """
id: spec
ordering: {{max_delay: 100ms, late: revise, horizon: 1h}}
streams:
  - {{topic: /s, action: filter, on_deny: undo}}
  - {{topic: /h, hold: [h], signals: {{h: 'msg.h'}}}}
  - {{topic: /u, ordered: false}}
properties:
  - {{id: p, time: {time}, formula: {formula}}}
  - {{id: guard, formula: 'not {{topic: /s, a: 7}} or once[:2] {{h: *}}', guards: [/s]}}
  - {{id: q, time: seconds, formula: '{{topic: /s}} implies once[:2s] {{h: 1}}'}}
"""


def revising(rng: random.Random, *, asks: bool) -> tuple[Judging, Time]:
    """A session whose events come up to 8 s late."""
    time: Time = rng.choice(("steps", "seconds"))
    formula = generate.formula(rng, time, rng.randint(2, 4))
    judging = Judging(REVISING.format(time=time, formula=json.dumps(render(formula, time))))
    coming = [(at + rng.choice((0, 0, 0, 1, 3, 8)) * SECOND, at, signals) for at, signals in generate.trace(rng, 16)]
    judging.keep(judging.core.attach("m", judging.plan.spec.by_key, coming[0][1]))
    for arrives, at, signals in sorted(coming, key=lambda each: each[0]):
        stream = rng.choice(("/s", "/s", "/h", "/u"))
        data = {"h": rng.choice((1, 2, [3] if asks else 2))} if stream == "/h" else dict(signals)
        judging.send(at, data, stream=stream, ask=asks and stream == "/s", late=arrives - at)
        if rng.random() < 0.1:
            judging.save()
        if rng.random() < 0.3:
            judging.keep(judging.core.advance(judging.core.now + rng.randint(0, 4 * SECOND)))
    judging.keep(judging.core.finish(judging.core.now))
    return judging, time


async def test_what_stands_is_told_of_a_session_that_revises_in_the_order_in_which_it_stands() -> None:
    compared = revised = 0
    for number in range(SEED, SEED + CASES // 4):
        rng = random.Random(f"revising {number}")
        asks = rng.random() < 0.3
        try:
            judging, time = revising(rng, asks=asks)
        except SpecError:
            continue  # it is refused for what can't be
        history = await judging.history()
        stands = {s.position: s async for page in history.steps(1, 0) for s in page if s.revision is None}
        for index in (0, rng.choice((1, 2))):
            steps = [s for s in stands.values() if not s.is_tick]
            found = await told(history, (rng.choice(steps).position - 1) * 3 + index + 1, steps=rng.choice((3, 500)))
            positions = [(n - 1) // 3 + 1 for n in found["numbers"]]
            assert len({*positions}) == len(positions)
            if not found["earlier"] and not found["later"]:
                assert {p for p in positions if not stands[p].is_tick} == {s.position for s in steps}
            wanted = [said(stands[p], "standing").outcomes[index] for p in positions]
            assert unrolled(found["outcomes"], len(positions)) == wanted
            assert unrolled(found["parts"][0]["runs"], len(positions)) == [HOLDS[str(o)] for o in wanted]
            check_order([stands[p] for p in positions])
            revised += sum(stands[p].standing is not None for p in positions)
            if index or asks or found["earlier"] or found["later"]:
                continue
            compared += compare(judging.plan.spec.properties[0].formula, time, found, stands)
    assert compared > CASES // 4
    assert revised > CASES // 8


def check_order(rows: list[StoredStep]) -> None:
    """Each has its place by its time, but for what has no order; an attempt that was taken back moves no deadline."""
    placed = [row for row in rows if row.is_tick or row.step.event.stream.name != "/u"]
    for same in ([row for row in placed if not row.is_tick], [row for row in placed if row.is_tick or row.number]):
        stamps = [row.step.stamp for row in same]
        assert stamps == sorted(stamps)


def compare(formula: Formula, time: Time, found: PartsRecord, stands: Mapping[int, StoredStep]) -> int:
    """Hold the truths against the table of the steps in the order that is told; returns how many there are."""
    positions, held, present, steps = [(n - 1) // 3 + 1 for n in found["numbers"]], dict[str, Any](), 0, []
    events = [i for i, p in enumerate(positions) if not stands[p].is_tick]
    for i in events:
        step = stands[positions[i]].step
        name = step.event.stream.name
        if name != "/u" or stands[positions[i]].number == 1:  # it came when there was no present yet
            present = max(present, step.stamp)
        held |= {"h": step.signals["h"]} if name == "/h" else {}
        steps.append((present, {**held, **step.signals, "kind": "topic", "topic": name}))
    compared = 0
    for part in found["parts"]:
        if part["needs"]:
            continue
        known = unrolled(part["runs"], len(positions))
        table = truths(at_path(formula, part["path"]), steps, time)
        for value, wanted in zip([known[i] for i in events], table, strict=True):
            assert value in ("holds" if wanted else "fails", "unknown", "not_told")
            compared += value in ("holds", "fails")
    return compared


async def test_a_deadline_that_does_not_stand_any_more_has_no_parts() -> None:
    text = REVISING.format(time="seconds", formula="'once[:5s] {a: 1}'")
    judging = Judging(text)
    judging.keep(judging.core.attach("m", judging.plan.spec.by_key, SECOND))
    judging.send(SECOND, {"a": 1})
    judging.keep(judging.core.advance(10 * SECOND))
    judging.send(5 * SECOND, {"a": 1}, late=5 * SECOND)
    judging.keep(judging.core.finish(judging.core.now + SECOND))
    tick = next(step for step in judging.kept if step.is_tick and step.outcomes[0].value == "currently_false")
    with pytest.raises(NoExplanationError, match="does not stand"):
        await told(await judging.history(), (tick.position - 1) * 3 + 1)
