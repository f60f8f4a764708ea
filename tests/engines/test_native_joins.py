"""Formulas of two and three variables that bind each other: judged to the end, in the work of their matches."""

from __future__ import annotations

import random
from collections import defaultdict
from collections.abc import Iterator

import pytest

from oracle_server.core.errors import EngineError
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.verdicts import NEGATIVE
from oracle_server.engines.native import NativeEngine
from tests import generate
from tests.brute import TimedSignals
from tests.engines.test_against_brute import SEED, compare, matches, outcomes
from tests.strategies import SECOND

SHARE = 0.02
"""Of what an engine may cost: a hundred combinations of values a step, over many of them."""
FILES = "forall[f]. {close: *f} -> exists[m]. pre (not {close: *f} since {open: *f, mode: *m})"
FIFO = "forall[x]. forall[y]. {exit: *y} and once ({enter: *y} and pre once {enter: *x}) -> pre once {exit: *x}"
ITERATOR = (
    "forall[m, c, i]. {next: *i} -> "
    "not once ({update: *m} and once ({iterator: *i, of: *c} and once {view: *c, map: *m}))"
)
ZONES = "forall[r, z]. {enters: *r, zone: *z} -> (not {closed: *z} since {permitted: *r})"
LATELY = "forall[r, z]. {enters: *r, zone: *z} -> (not {closed: *z} since[:40] {permitted: *r})"
_KEPT = (
    "historically ({reads: *t, of: *x} or {writes: *t, of: *x} -> "
    "(not {frees: *t, lock: *l} since {takes: *t, lock: *l}))"
)
RACE = (
    "forall[t, u, x]. once ({reads: *t, of: *x} or {writes: *t, of: *x}) and once {writes: *u, of: *x} -> "
    f"exists[l]. {_KEPT} and {_KEPT.replace('*t', '*u')}"
)

Told = tuple[dict[str, int], bool]
"""The signals of a step, and whether the property holds there."""


def files(rng: random.Random, count: int) -> Iterator[Told]:
    """Many files are opened and stay open for long; now and then one is closed that is not open."""
    opened = dict.fromkeys(range(count), 0)
    yield from (({"open": f, "mode": f % 3}, True) for f in opened)
    for n in range(count):
        f = rng.choice([n, count + n]) if n % 10 == 0 else n
        yield {"close": f}, opened.pop(f, None) is not None


def fifo(rng: random.Random, count: int) -> Iterator[Told]:
    """A queue that grows for long; now and then something that came in later goes out first."""
    queue: list[int] = []
    left = set[int]()
    for n in range(count):
        queue.append(n)
        yield {"enter": n}, True
        if n % 3 == 2:
            out = queue[rng.randint(1, len(queue) - 1) if n % 30 == 2 else 0]
            holds = all(x in left for x in range(out))
            left.add(out)
            queue.remove(out)
            yield {"exit": out}, holds


def iterators(rng: random.Random, count: int) -> Iterator[Told]:
    """Views of many maps, and an iterator or two over each; now and then a map changes, and one of its goes on."""
    spoilt, made = set[int](), defaultdict[int, list[int]](list)
    for n in range(count):
        yield {"view": n, "map": n % (count // 4)}, True
        yield {"iterator": n, "of": n}, True
        made[n % (count // 4)].append(n)
        if n % 5 == 0:
            changed = rng.randint(0, n) % (count // 4)
            spoilt.update(made[changed])
            yield {"update": changed}, True
        i = rng.randint(0, n)
        yield {"next": i}, i not in spoilt


def zones(rng: random.Random, count: int, most: int | None = None) -> Iterator[Told]:
    """Robots are permitted to enter the zones that are open, until these are closed."""
    permitted, closed = dict[int, int](), dict[int, int]()
    for n in range(count):
        at = 3 * n + 1
        permitted[n] = at
        yield {"permitted": n}, True
        closed[zone := rng.randint(0, n)] = at + 1
        yield {"closed": zone}, True
        robot, other = rng.randint(max(0, n - 20), n + 1), rng.randint(0, n)
        since = permitted.get(robot, -1)
        recent = most is None or at + 2 - since <= most
        yield {"enters": robot, "zone": other}, since >= 0 and recent and closed.get(other, -1) <= since


def lately(rng: random.Random, count: int) -> Iterator[Told]:
    """The same where a permission lasts for 40 steps."""
    return zones(rng, count, 40)


def races(rng: random.Random, count: int) -> Iterator[Told]:
    """Threads take their locks, and read and write what these guard; in the end one does without them."""
    threads = range(max(2, count // 100))
    yield from (({"takes": t, "lock": lock}, True) for t in threads for lock in {t, t + 1, 1000})
    for _ in range(count):
        yield {rng.choice(["reads", "writes"]): rng.choice(threads), "of": rng.choice(threads)}, True
        t = rng.choice(threads)
        yield {"frees": t, "lock": t}, True
        yield {"takes": t, "lock": t}, True
    yield {"writes": 0, "of": 0}, True
    yield {"frees": 1, "lock": 1000}, True
    yield from (({"writes": 1, "of": x}, False) for x in [0] * 6)


TRACES = {
    "files": (FILES, files),
    "fifo": (FIFO, fifo),
    "iterators": (ITERATOR, iterators),
    "zones": (ZONES, zones),
    "lately": (LATELY, lately),
    "races": (RACE, races),
}


@pytest.mark.parametrize("time", ["steps", "seconds"])
@pytest.mark.parametrize("name", TRACES)
def test_all_is_judged_and_right_though_there_are_many_values(time: Time, name: str) -> None:
    text, trace = TRACES[name]
    formula = parse_formula(text.replace("[:40]", "[:40s]") if time == "seconds" else text, time)
    engine, failed = NativeEngine(formula, time, SHARE), 0
    for n, (signals, holds) in enumerate(trace(random.Random(name), 600), start=1):
        ((at, found),) = list(matches(formula, [(n * SECOND, {**signals})]))
        assert (engine.step(at, found) not in NEGATIVE) is holds, f"{name}, step {n}: {signals}"
        failed += not holds
    assert failed > 5


@pytest.mark.parametrize("time", ["steps", "seconds"])
@pytest.mark.parametrize("name", TRACES)
def test_they_are_what_the_table_says_at_any_order_of_events(time: Time, name: str) -> None:
    text, trace = TRACES[name]
    rng = random.Random(f"{name} {time} {SEED}")
    keys = sorted({key for signals, _ in trace(rng, 20) for key in signals})
    for _ in range(30):
        steps: list[TimedSignals] = [
            (at, {key: rng.choice((1, 2)) for key in rng.sample(keys, rng.randint(1, 2))})
            for at, _ in generate.trace(rng, rng.randint(5, 14))
        ]
        compare(lambda formula: NativeEngine(formula, time), parse_formula(text.replace("40", "3"), time), steps, time)


def test_what_must_be_listed_has_an_end() -> None:
    formula = parse_formula("exists[x, y]. once ({a: *x} and once {b: *y})")
    steps: list[TimedSignals] = [(n, {"a": n, "b": n}) for n in range(2_000)]
    with pytest.raises(EngineError, match="cost too much"):
        outcomes(NativeEngine(formula, share=SHARE), formula, steps)
