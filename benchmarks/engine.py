"""What a step of each engine costs, and what a property takes: native beside reelay, in turns, in one run.

    python benchmarks/engine.py [--json] [--quick] [--large] [--growth] [--derived] [--obligations] [--joins]

Each formula is stepped through events that meet its atoms in turn, one atom at an event, every value fresh until there
are as many as the line says, and then the same ones again. *µs* is the mean of a step, the best of three turns; *ratio*
native by reelay. *ms* is the making of a fresh engine, *kB* what idle ones take of the process's memory, each.
Times are the processor's, so that other programs do not count. With `--large` up to 10^6 distinct values, for which
reelay takes a gigabyte. `--growth` tells instead what 10^5 and 10^6 steps of bounded formulas with fresh values all
along have added to the process, in the native engine. `--derived` tells instead what derived signals cost at a step
that concerns them, with windows of 10^2 and 10^5 samples, by a step of the native engine; what a whole step costs that
concerns none, by one without derived signals; and what the steps from 10^4 to 10^6 have added to the process.
`--obligations` steps what waits for what comes beside the same asked of the past, in turns, through the same events,
and with ten and 99,000 open. `--joins` steps formulas of two and three variables that bind each other through long
traces, and prints how many of the events were judged, what a step took, and what the engine has added to the process.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from oracle_server.core.atoms import Match
from oracle_server.core.engine import Engine
from oracle_server.core.errors import EngineError
from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.tree import Formula
from oracle_server.engines.native import NativeEngine
from oracle_server.engines.reelay import ReelayEngine
from oracle_server.specfiles.load import load_spec

ROOT = Path(__file__).resolve().parents[1]
PAGE = os.sysconf("SC_PAGE_SIZE")
IDLE = 200
_kept: list[list[Engine]] = []
"""The idle engines: were they let go, the next ones would take their memory."""

FORMULAS = {
    "propositional": "not {a} or {b}",
    "bounded": "{a} -> once[:10] {b}",
    "nested": "historically[2:20] ({a} -> once[:5] {b}) since {c}",
    "quantified": "forall[i]. {r: *i} -> once {q: *i}",
    "quantified, bounded": "forall[i]. {r: *i} -> once[:100] {q: *i}",
    "quantified, nested": "forall[i]. {r: *i} -> ({a} since[:50] {q: *i}) or historically[:20] not {p: *i}",
}


BOUNDED: dict[str, tuple[Time, str]] = {
    "a window": ("steps", "forall[i]. {r: *i} -> once[:100] {q: *i}"),
    "a delayed one": ("steps", "forall[i]. {r: *i} -> once[20:100] {q: *i}"),
    "since": ("steps", FORMULAS["quantified, nested"]),
    "windows in a window": (
        "steps",
        "historically[:50] (exists[i]. {r: *i} and not once[5:20] ({q: *i} since[:30] {p: *i}))",
    ),
    "a window of time": ("seconds", "forall[i]. {r: *i} -> once[:100ms] {q: *i}"),
    "a delayed one of time": ("seconds", "forall[i]. {r: *i} -> ({a} since[20ms:100ms] {q: *i})"),
    "an obligation": ("steps", "forall[i]. {r: *i} -> eventually[:100] {q: *i}"),
    "one of time": ("seconds", "forall[i]. {r: *i} -> {a} until[20ms:100ms] {q: *i}"),
    "one within another": ("seconds", "{r} -> always[:100ms] ({a} -> eventually[:50ms] {q})"),
}


OBLIGATIONS: dict[str, tuple[Time, str, str]] = {
    "eventually": ("steps", "{a} -> eventually[:2] {b}", "not (not {b} since[2:] {a})"),
    "eventually, in time": ("seconds", "{a} -> eventually[:2ms] {b}", "not (not {b} since[2ms:] {a})"),
    "always": ("steps", "{a} -> always[:2] not {b}", "not (not {b} since[2:] {a})"),
    "until": ("steps", "{a} -> not {c} until[:2] {b}", "not (not {b} since[2:] {a})"),
    "by key": (
        "steps",
        "forall[i]. {a: *i} -> eventually[:100] {b: *i}",
        "forall[i]. not (not {b: *i} since[100:] {a: *i})",
    ),
    "by key, in time": (
        "seconds",
        "forall[i]. {a: *i} -> eventually[:100ms] {b: *i}",
        "forall[i]. not (not {b: *i} since[100ms:] {a: *i})",
    ),
}
"""What waits for what comes, and the same asked of the past."""


JOINS: dict[str, tuple[str, int]] = {
    "files": ("forall[f]. {close: *f} -> exists[m]. pre (not {close: *f} since {open: *f, mode: *m})", 110_004),
    "fifo": (
        "forall[x]. forall[y]. {exit: *y} and once ({enter: *y} and pre once {enter: *x}) -> pre once {exit: *x}",
        5_051,
    ),
    "iterators": (
        "forall[m, c, i]. {next: *i} -> "
        "not once ({update: *m} and once ({iterator: *i, of: *c} and once {view: *c, map: *m}))",
        10_801,
    ),
}
"""Formulas of several variables that bind each other, and how many events they are stepped through."""


@dataclass(frozen=True)
class Line:
    """One formula with so many distinct values over so many steps."""

    what: str
    values: int
    steps: int
    native: float
    reelay: float
    native_ms: float
    reelay_ms: float

    @property
    def ratio(self) -> float:
        return self.native / self.reelay


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description="Measure the native engine beside reelay.")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.add_argument("--quick", action="store_true", help="measure little: to see that it runs")
    parser.add_argument("--large", action="store_true", help="measure 10^6 distinct values too")
    parser.add_argument("--growth", action="store_true", help="measure what 10^6 steps add to the process")
    parser.add_argument("--derived", action="store_true", help="measure derived signals beside a native step")
    parser.add_argument("--obligations", action="store_true", help="measure what waits for what comes")
    parser.add_argument("--joins", action="store_true", help="measure formulas of several variables")
    args = parser.parse_args()
    if args.joins:
        show_joins(50 if args.quick else 1)
        return
    if args.derived:
        importlib.import_module("derived").show(quick=args.quick)
        return
    if args.growth:
        show_growth()
        return
    if args.obligations:
        show_obligations(2_000 if args.quick else 60_000)
        return
    idle = {name: (taken(NativeEngine, f), taken(ReelayEngine, f)) for name, f in formulas()}
    steps = 2_000 if args.quick else 30_000
    lines = [measure(name, formula, 100, steps) for name, formula in formulas()]
    sizes = (1_000,) if args.quick else (1_000, 10_000, 100_000, *((1_000_000,) if args.large else ()))
    grown = parse_formula(FORMULAS["quantified"])
    lines += [measure("quantified", grown, size, max(steps, 2 * size)) for size in sizes]
    if args.json:
        found = [asdict(line) | {"ratio": line.ratio, "kb": idle[line.what]} for line in lines]
        print(json.dumps(found, indent=2))
        return
    head = f"{'formula':32} {'values':>8} {'steps':>8} {'native µs':>10} {'reelay µs':>10} {'ratio':>6}"
    print(f"{head} {'ms':>14} {'kB':>14}")
    for line in lines:
        making = f"{line.native_ms:.2f} / {line.reelay_ms:.1f}"
        kb = "{:.0f} / {:.0f}".format(*idle[line.what])
        told = f"{line.what:32} {line.values:8} {line.steps:8} {line.native:10.2f} {line.reelay:10.2f}"
        print(f"{told} {line.ratio:6.2f} {making:>14} {kb:>14}")


def show_obligations(steps: int) -> None:
    """Step obligations, and the same asked of the past, in turns; then with few and with many open."""
    print(f"{'obligation':32} {'µs':>8} {'past µs':>8} {'ratio':>6}")
    for name, (clock, ahead, past) in OBLIGATIONS.items():
        turns = [(clocked(ahead, clock, steps), clocked(past, clock, steps)) for _ in range(3)]
        one, other = (min(times) for times in zip(*turns, strict=True))
        print(f"{name:32} {one:8.2f} {other:8.2f} {one / other:6.2f}", flush=True)
    print(f"{'open':32} {'µs':>8} {'by key':>8}")
    for count in (10, 99_000):
        alone, keyed = (min(step(count, steps) for _ in range(3)) for step in (lasting, opened))
        print(f"{count:<32} {alone:8.2f} {keyed:8.2f}", flush=True)


def clocked(text: str, clock: Time, steps: int) -> float:
    """Microseconds that a step takes, the steps a millisecond apart."""
    formula = parse_formula(text, clock)
    engine, events = NativeEngine(formula, clock), list(stream(formula, 100, steps))
    begun = time.process_time()
    for n, found in enumerate(events):
        engine.step(n * 10**6, found)
    return (time.process_time() - begun) / steps * 1e6


def lasting(count: int, steps: int) -> float:
    """The same without variables where so many are open, and each step opens one and ends another."""
    engine = NativeEngine(parse_formula(f"{{a}} -> always[:{count}] not {{b}}"))
    events: list[list[Match]] = [[(), None]] * (count + 5)
    for n, found in enumerate(events):
        engine.step(n, found)
    begun = time.process_time()
    for n in range(steps):
        engine.step(count + 5 + n, events[0])
    return (time.process_time() - begun) / steps * 1e6


def opened(count: int, steps: int) -> float:
    """The same by key where so many are open, and each step opens another one or answers that."""
    engine = NativeEngine(parse_formula("forall[i]. {a: *i} -> eventually[:10000000] {b: *i}"))
    for n in range(count):
        engine.step(n, [(f"o{n}",), None])
    events: list[list[Match]] = [[None, None] for _ in range(steps)]
    for n, found in enumerate(events):
        found[n % 2] = (f"v{n // 2}",)
    begun = time.process_time()
    for n, found in enumerate(events, count):
        engine.step(n, found)
    return (time.process_time() - begun) / steps * 1e6


def show_joins(part: int) -> None:
    """Step formulas of several variables through traces, or the first so many-th of them."""
    print(f"{'joined':32} {'events':>8} {'judged':>8} {'native µs':>10} {'kB':>8}")
    for name, (text, count) in JOINS.items():
        events = list(joined(name, count // part))
        engine, before, judged = NativeEngine(parse_formula(text)), resident(), 0
        begun = time.process_time()
        for found in events:
            try:
                engine.step(judged, found)
            except EngineError:
                break
            judged += 1
        cost = (time.process_time() - begun) / max(judged, 1) * 1e6
        print(f"{name:32} {len(events):8} {judged:8} {cost:10.2f} {(resident() - before) / 1e3:8.0f}", flush=True)


def joined(name: str, count: int) -> Iterator[list[Match]]:
    """What each atom makes of events: many files, a queue that grows, and maps with views, iterators and changes."""
    opened = count * 8 // 11
    for n in range(count):
        if name == "files":
            yield [None, (str(n), str(n % 3))] if n < opened else [(str(n - opened),), None]
        elif name == "fifo":
            out, into = ((str(n // 3),), None) if n % 3 == 2 else (None, (str(n - n // 3),))
            yield [out, into, into, out]
        else:
            turn, what = divmod(n, 4)
            found: list[Match] = [None] * 4
            fields = [(str(turn), str(turn % 100)), (str(turn), str(turn)), (str(turn * 7 % 100),), (str(turn),)]
            found[3 - what] = fields[what]
            yield found


def show_growth() -> None:
    """Step each bounded formula a million times."""
    print(f"{'formula':32} {'kB at 10^5':>12} {'kB at 10^6':>12} {'native µs':>10}")
    for name, (clock, text) in BOUNDED.items():
        early, late, cost = growth(parse_formula(text, clock), clock)
        print(f"{name:32} {early:12.0f} {late:12.0f} {cost:10.2f}", flush=True)


def growth(formula: Formula, clock: Time) -> tuple[float, float, float]:
    """Kilobytes that 10^5 and 10^6 steps, a millisecond apart, have added to the process, and microseconds a step."""
    engine, before, early = NativeEngine(formula, clock), resident(), 0
    begun = time.process_time()
    for n, found in enumerate(stream(formula, 10**6, 10**6)):
        engine.step(n * 10**6, found)
        if n == 10**5:
            early = resident()
    cost = (time.process_time() - begun) / 10**6 * 1e6
    return (early - before) / 1e3, (resident() - before) / 1e3, cost


def formulas() -> Iterator[tuple[str, Formula]]:
    """The formulas, and the case study's six properties."""
    for name, text in FORMULAS.items():
        yield name, parse_formula(text)
    for prop in load_spec(ROOT / "specs/battery_uav.yaml").spec.properties:
        yield prop.id, prop.formula


def measure(what: str, formula: Formula, values: int, steps: int) -> Line:
    """Step both engines through the same events, in turns."""
    events = list(stream(formula, values, steps))
    turns = 1 if steps > 100_000 else 3
    native, reelay = ([timed(make, formula, events) for _ in range(turns)] for make in (NativeEngine, ReelayEngine))
    best = [min(times) for times in (*zip(*native, strict=True), *zip(*reelay, strict=True))]
    return Line(what, values, steps, best[1], best[3], best[0], best[2])


def stream(formula: Formula, values: int, steps: int) -> Iterator[list[Match]]:
    """What each atom makes of each event."""
    atoms = tree.atoms(formula)
    for n in range(steps):
        found: list[Match] = [None] * len(atoms)
        atom = n % len(atoms)
        found[atom] = tuple(str(n // len(atoms) % values) for _ in atoms[atom].refs)
        yield found


def timed(make: Callable[[Formula], Engine], formula: Formula, events: list[list[Match]]) -> tuple[float, float]:
    """Milliseconds to make an engine, and microseconds a step."""
    begun = time.process_time()
    engine = make(formula)
    made = time.process_time()
    for n, found in enumerate(events):
        engine.step(n, found)
    return (made - begun) * 1e3, (time.process_time() - made) / len(events) * 1e6


def taken(make: Callable[[Formula], Engine], formula: Formula) -> float:
    """Kilobytes of the process's memory that an idle engine takes."""
    count = IDLE if make is NativeEngine else 3
    before = resident()
    _kept.append([make(formula) for _ in range(count)])
    return max(0, resident() - before) / count / 1e3


def resident() -> int:
    """Bytes of this process in memory."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE


if __name__ == "__main__":
    main()
