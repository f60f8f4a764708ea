"""What it costs that late events put the verdicts right: the judge alone, beside the same without `late: revise`.

    python benchmarks/revising.py [--json] [--quick]

*A step*: the same events, none of them late, judged by a session's judge with and without; the best of three turns, in
turns. *Late*: an event that comes 1,000 steps late, or 100 of them at once, beside judging 1,000 steps as they come
with `late: revise`. *A kept step*: what the judge's memory grows by for each step that it may have to judge again.
Times are the processor's, so that other programs do not count, and garbage is collected as seldom as in the server.
What a server takes is in `oracle.py`.
"""

from __future__ import annotations

import argparse
import gc
import json
import sys
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import asdict, replace
from itertools import count
from pathlib import Path
from typing import Literal

from lines import Line, table
from oracle import battery_events

from oracle_server.core.events import Event, Step, StreamKey
from oracle_server.core.judging.judge import Judge
from oracle_server.core.plan import Plan, plan
from oracle_server.core.revise.judge import RevisingJudge
from oracle_server.core.spec import SECOND
from oracle_server.engines.table import make_engines
from oracle_server.process.garbage import collect_rarely
from oracle_server.specfiles.load import parse_spec

ROOT = Path(__file__).resolve().parents[1]
BACK = 1_000
"""How many steps a late event comes late."""
MS = 10**6
HORIZON = 100 * SECOND
"""So long that as many steps are kept as can be."""

TIMED = """
id: answered
streams:
  - {topic: /asked, signals: {id: string(msg.id)}}
  - {topic: /answered, signals: {id: string(msg.id)}}
properties:
  - id: answer_has_a_question
    time: seconds
    formula: 'forall[i]. {topic: "/answered", id: *i} -> once[:200ms]{topic: "/asked", id: *i}'
"""

DERIVED = """
id: counted
streams:
  - {topic: /asked, signals: {id: msg.id}}
  - {topic: /answered, signals: {id: msg.id}}
derive:
  often: {count: '{topic: "/asked"}', over: 1s}
  mean_id: {mean: id, over: 100}
  quiet: {age: '{topic: "/asked"}', by: id, forget: 1s}
properties:
  - {id: not_too_often, time: seconds, formula: '{often <= 1000}'}
  - {id: few, time: seconds, formula: '{topic: "/answered"} -> {mean_id >= 0}'}
  - {id: soon, time: seconds, formula: '{topic: "/answered"} -> {quiet < 0.2}'}
"""


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description="Measure what revising costs the judge.")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.add_argument("--quick", action="store_true", help="measure little: to see that it runs")
    args = parser.parse_args()
    collect_rarely()
    number, turns = (3_000, 1) if args.quick else (9_000, 3)
    battery = (ROOT / "specs" / "battery_uav.yaml").read_text()
    lines: list[Line] = []
    for name, text, make in (
        ("battery_uav, 6 properties", battery, uav),
        ("timed, quantified", TIMED, questions),
        ("3 derived signals", DERIVED, questions),
    ):
        lines += measure(name, text, make, number, turns)
    if args.json:
        print(json.dumps([asdict(line) | {"ratio": line.ratio, "met": line.met} for line in lines], indent=2))
    else:
        print(table(lines, ("revise", "beside")))


def measure(name: str, text: str, make: Callable[[Plan, int], list[Step]], number: int, turns: int) -> list[Line]:
    """All lines of one spec."""
    plain, revising = with_lateness(text, name, "judge"), with_lateness(text, name, "revise")
    steps = make(plain, number)
    with_it, without, late, burst = [], [], [], []
    for _ in range(turns):
        without.append(timed(lambda: judged(plain, steps)))
        with_it.append(timed(lambda: judged(revising, steps)))
        late.append(placed(revising, steps, 1))
        burst.append(placed(revising, steps, 100))
    step, bare = min(with_it) / number * 1e6, min(without) / number * 1e6
    thousand = step * BACK / 1e3
    kept = grown(revising, steps) - grown(plain, steps)
    return [
        Line(f"a step: {name}", "µs", step, bare, 1.5),
        Line("  1 event 1,000 steps late", "ms", min(late) * 1e3, thousand, 1.4),
        Line("  100 of them at once", "ms", min(burst) * 1e3, thousand, 1.4),
        Line("  a kept step, beside 3 kB", "bytes", kept / min(number, 10_000), 3_000, 1.0),
    ]


def with_lateness(text: str, name: str, late: Literal["judge", "revise"]) -> Plan:
    """A spec that treats late events so."""
    spec = parse_spec(text, name).spec
    return plan(replace(spec, ordering=replace(spec.ordering, late=late, horizon=HORIZON)))


def judge_of(ready: Plan) -> Judge:
    """A judge as a session has it."""
    (own,) = make_engines(ready)
    if ready.spec.ordering.late != "revise":
        return Judge(ready, own, "publication", count(1))
    judge = RevisingJudge(ready, own, "publication", count(1))
    judge.ticking = ready.timed
    return judge


def judged(ready: Plan, steps: list[Step]) -> Judge:
    """A judge that has judged these steps, and the deadlines between them."""
    judge = judge_of(ready)
    if isinstance(judge, RevisingJudge):
        for step in steps:
            judge.take(step, step.stamp)
        return judge
    for step in steps:
        while ready.timed and (deadline := judge.next_deadline) is not None and deadline < step.stamp:
            judge.tick(deadline, step.stamp)
        judge.judge(step, step.stamp)
    return judge


def placed(ready: Plan, steps: list[Step], late: int) -> float:
    """The seconds that it takes to put the last of some steps in place, the first of them 1,000 steps late."""
    begin, end = len(steps) - BACK, len(steps) - BACK + late
    held = steps[begin:end]
    judge = judged(ready, steps[:begin] + steps[end:])
    assert isinstance(judge, RevisingJudge)
    now = steps[-1].stamp

    def place() -> None:
        judge.place(held)
        judge.go_on(now, lambda: False)

    return timed(place)


def timed(do: Callable[[], object]) -> float:
    """The seconds of the processor that something takes."""
    gc.collect()
    begun = time.process_time()
    do()
    return time.process_time() - begun


def grown(ready: Plan, steps: list[Step]) -> int:
    """The bytes that a judge has taken for steps and keeps."""
    gc.collect()
    tracemalloc.start()
    judge = judged(ready, steps)
    gc.collect()
    taken = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert judge.counters.steps
    return taken


def uav(ready: Plan, number: int) -> list[Step]:
    """The simulated UAV's messages."""
    return [
        step_of(ready, each["stream"], each["kind"], seq, each["stamp"], each["data"], each.get("call"))
        for seq, each in enumerate(battery_events(number), start=1)
    ]


def questions(ready: Plan, number: int) -> list[Step]:
    """A question every 10 ms, and its answer 5 ms later; one in a hundred is too late."""
    steps = []
    for n in range(number // 2):
        asked, after = 10**18 + n * 10 * MS, 5 * MS
        steps.append(step_of(ready, "/asked", "topic", 2 * n + 1, asked, {"id": n}))
        steps.append(step_of(ready, "/answered", "topic", 2 * n + 2, asked + after, {"id": n if n % 100 else -1}))
    return steps


def step_of(
    ready: Plan, stream: str, kind: str, seq: int, stamp: int, data: dict[str, object], call: int | None = None
) -> Step:
    """The step of an event that came as it was published."""
    key = StreamKey(stream, kind)  # type: ignore[arg-type]
    signals, failed = ready.streams[key].project(data)
    return Step(Event(key, "m", seq, stamp, stamp, None, "", call), signals, failed, stamp)


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    main()
