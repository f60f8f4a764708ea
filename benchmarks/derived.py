"""What derived signals cost; shown by `python benchmarks/engine.py --derived`."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from functools import partial
from itertools import cycle
from pathlib import Path

from oracle_server.core.atoms import Match
from oracle_server.core.derived.state import Derived
from oracle_server.core.events import Event, Step, StreamKey
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.judging.judge import Judge
from oracle_server.core.plan import Plan, plan
from oracle_server.core.session import Session
from oracle_server.engines.native import NativeEngine
from oracle_server.engines.table import make_engines
from oracle_server.specfiles.load import parse_spec

NATIVE = "{a} -> once[:10] {b}"
"""The formula whose step is the measure."""
STREAM = StreamKey("/a", "topic")
OTHER = StreamKey("/b", "topic")
STEP = 10**6
"""Nanoseconds between two steps."""
SIGNALS = {
    "count": "{count: '{topic: /a}', over: WINDOW}",
    "rate": "{rate: '{topic: /a}', over: WINDOW}",
    "min": "{min: x, over: WINDOW}",
    "max": "{max: x, over: WINDOW}",
    "age": "{age: '{topic: /a}'}",
    "last": "{last: x}",
    "sum": "{sum: x, over: WINDOW}",
    "mean": "{mean: x, over: WINDOW}",
    "count, by 1000 keys": "{count: '{topic: /a}', over: WINDOW, by: k}",
    "states": "{start: s, states: {s: {on: t}, t: {off: s}}, otherwise: stay}",
    "states, by 1000 keys": "{start: s, states: {s: {on: t}, t: {off: s}}, otherwise: stay, by: k, forget: 24h}",
    "follows": "{follows: state, states: {IDLE: [AUTO], AUTO: [IDLE, FAULT], FAULT: [IDLE]}}",
    "sequence": "{sequence: '(off on)* off?'}",
}


def show(*, quick: bool) -> None:
    """Measure, and print."""
    steps = 20_000 if quick else 300_000
    native = best(partial(native_step, steps))
    print(f"a native step of `{NATIVE}`: {native:.2f} µs")
    print(f"{'signal':22} {'10^2 µs':>9} {'ratio':>6} {'10^5 µs':>9} {'ratio':>6}")
    for name, text in SIGNALS.items():
        small, large = (best(partial(derived_step, text, size, steps)) for size in (100, 90_000))
        print(f"{name:22} {small:9.2f} {small / native:6.2f} {large:9.2f} {large / native:6.2f}", flush=True)
    turns = [(whole_step("", steps // 3), whole_step(SIGNALS["count"], steps // 3)) for _ in range(5)]
    plain, beside = (min(times) for times in zip(*turns, strict=True))
    more = (beside - plain) / native
    print(f"a whole step that concerns none: {beside:.2f} µs by {plain:.2f}, {more:+.2f} native steps")
    print(f"a machine, of 10^5 keys: {machine_bytes(10**5):.0f} bytes", flush=True)
    for name in ("count", "sum", "max", "count, by 1000 keys"):
        last = 2 * 10**4 if quick else 10**6
        print(f"{name:22} {growth(SIGNALS[name], last):9.0f} kB from 10^4 to {last:,} steps", flush=True)


def native_step(steps: int) -> float:
    """Microseconds of a step of the native engine."""
    engine = NativeEngine(parse_formula(NATIVE))
    events: list[list[Match]] = [[(), None], [None, ()]]
    turns = list(zip(range(steps), cycle(events), strict=False))
    begun = time.process_time()
    for n, found in turns:
        engine.step(n, found)
    return (time.process_time() - begun) / steps * 1e6


def derived_step(text: str, size: int, steps: int) -> float:
    """Microseconds of a step of one derived signal, over a window with so many samples."""
    ready = made(text, size)
    derived, parts = Derived(ready.derived), ready.streams[STREAM].derives
    derived.begin(0)
    events = [step_of(n, STREAM) for n in range(1_000)]
    for n in range(size + size // 10):
        derived.step(parts, events[n % 1_000], dict(events[n % 1_000].signals), frozenset(), n * STEP, n + 1)
    first, nothing = size + size // 10, frozenset[str]()
    times = ((n * STEP, n + 1) for n in range(first, first + steps))
    given = cycle([(event, dict(event.signals)) for event in events[first % 1_000 :] + events[: first % 1_000]])
    turns = [(*event, *at) for event, at in zip(given, times, strict=False)]
    begun = time.process_time()
    for event, signals, now, number in turns:
        derived.step(parts, event, signals, nothing, now, number)
    return (time.process_time() - begun) / steps * 1e6


def whole_step(text: str, steps: int) -> float:
    """Microseconds of all that a judge does at an event of a stream that concerns no derived signal."""
    ready = made(text, 100)
    session = Session(ready, make_engines(ready), begun=0)
    judge: Judge = session.judges["arrival"]
    events = [step_of(n, OTHER) for n in range(1_000)]
    for event in events:
        judge.judge(event, 0)
    begun = time.process_time()
    for n in range(steps):
        judge.judge(events[n % 1_000], 0)
    return (time.process_time() - begun) / steps * 1e6


def growth(text: str, steps: int) -> float:
    """Kilobytes that the steps from 10^4 on have added to the process."""
    ready, early = made(text, 1_000), 0
    derived, parts = Derived(ready.derived), ready.streams[STREAM].derives
    for n in range(steps):
        event = step_of(n, STREAM)
        derived.step(parts, event, dict(event.signals), frozenset(), n * STEP, n + 1)
        if n == 10**4:
            early = resident()
    return (resident() - early) / 1e3


def machine_bytes(count: int) -> float:
    """Bytes that each of so many keys of a machine has added to the process, its key included."""
    ready = made(SIGNALS["states, by 1000 keys"], 100)
    derived, parts = Derived(ready.derived), ready.streams[STREAM].derives
    before = resident()
    for n in range(2 * count):
        event = step_of(n, STREAM)
        signals: dict[str, Scalar] = {**event.signals, "k": f"key{n % count}"}
        derived.step(parts, Step(event.event, signals, frozenset(), n), dict(signals), frozenset(), n * STEP, n + 1)
    return (resident() - before) / count


def made(text: str, size: int) -> Plan:
    """A plan with one derived signal, over a window that holds so many samples."""
    derive = f"derive: {{d: {text.replace('WINDOW', f'{size}ms')}}}" if text else ""
    spec = f"""
id: t
ordering: {{by: arrival}}
streams:
  - {{topic: /a, signals: {{x: msg.x, k: msg.k, state: msg.state}}}}
  - {{topic: /b, signals: {{x: msg.x}}}}
define: {{on: '{{state: AUTO}}', off: '{{state: IDLE}}'}}
{derive}
properties:
  - {{id: p, formula: '{{topic: /a}} -> once[:10] {{topic: /b}}'}}
  - {{id: q, formula: '{{topic: /a{", d: *" if text else ""}}}'}}
"""
    return plan(parse_spec(spec, "benchmark").spec)


def step_of(number: int, stream: StreamKey) -> Step:
    """A step with a number that jumps, and one of 1000 keys."""
    signals: dict[str, Scalar] = {
        "x": (number * 7919 % 1_000) / 7,
        "k": f"key{number % 1_000}",
        "state": ("IDLE", "AUTO")[number % 2],
    }
    event = Event(stream, "m", number + 1, number * STEP, number * STEP, {})
    return Step(event, signals if stream == STREAM else {"x": 1.5}, frozenset(), number * STEP)


def best(measure: Callable[[], float]) -> float:
    """The least of three turns."""
    return min(measure() for _ in range(3))


def resident() -> int:
    """Bytes of this process in memory."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
