"""Patterns and requirements as they are judged, against their English definitions by brute force.

    CASES=1000 pytest tests/core/sentences/test_english.py

is the long run: so many traces for each sentence.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from oracle_server.core.atoms import Match, Matches, specialise
from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import looks_ahead
from oracle_server.core.formula.definitions import defined
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.sentences.pattern import read_pattern
from oracle_server.core.sentences.reader import Meant
from oracle_server.core.sentences.requirement import read_requirement
from oracle_server.core.verdicts import NEGATIVE
from oracle_server.engines.native import NativeEngine
from tests import english
from tests.english import SECOND, Asked, Broken, Step, Trace

CASES = int(os.environ.get("CASES", "8"))
LETTERS = "pqmabcrs"
NAMES = defined({letter: f"{{{letter}}}" for letter in LETTERS}, [])
LATELY = defined({letter: f"once[:2s] {{{letter}}}" for letter in LETTERS}, [])
"""Names of what time ends, between steps too."""
FALSE = 0
"""What an engine calls an obligation that was not met."""

SCOPES = {
    "globally: ": english.globally,
    "after p: ": english.after,
    "until q: ": english.until,
    "after p until q: ": english.between,
    "while m: ": english.while_,
}
PATTERNS = {
    "no b": english.absence,
    "some b": english.existence,
    "a causes b": english.response,
    "b requires a": english.precedence,
    "a forbids b": english.prevention,
    "always b": english.universality,
}
MODES = {
    "": english.globally,
    "in m mode, ": english.while_,
    "except in m, ": english.unless,
    "before m, ": english.before_mode,
    "after m, ": english.after_mode,
}
CONDITIONS = {"": "", "when c, ": "when", "where c ": "when", "whenever c ": "whenever"}
TIMINGS = {
    "immediately": english.immediately,
    "at the next timepoint": english.at_next,
    "always": english.always,
    "never": english.never,
    "for": english.for_,
    "until s": english.until_stop,
    "before s": english.before_stop,
    "finally": english.finally_,
    "within": english.within,
    "after": english.after_steps,
    "eventually": english.eventually,
    "": english.eventually,
}
ENDLESS = ("", "after m, ")
"""The modes that never end, of which nothing is `finally`."""

many = settings(max_examples=CASES, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def traces(letters: str) -> st.SearchStrategy[list[tuple[int, str]]]:
    """Pauses before steps, of which many are none, and the letters of these."""
    some = st.lists(st.sampled_from(letters), max_size=3, unique=True).map("".join)
    return st.lists(st.tuples(st.sampled_from((0, 0, 1, 1, 2, 4)), some), min_size=1, max_size=12)


def made(steps: list[tuple[int, str]], *, timed: bool) -> Trace:
    now, found = 5, []
    for pause, letters in steps:
        now += pause
        found.append(Step(now, letters))
    return Trace(found, timed)


def judged(meant: Meant, trace: Trace, *, shaken: bool = False, lasts: bool = False) -> Broken:
    """What the engine makes of a trace: which steps broke the formula at each one.

    At deadlines what held at the step before holds on, and nothing comes; they break nothing but what `lasts`.
    `shaken`: before each step another one is tried and taken back, and the engine is saved and restored.
    """
    engine = NativeEngine(meant.formula, meant.time)
    atoms = tree.atoms(meant.formula)
    tests = specialise(atoms, {}, lambda _: True)
    waits = looks_ahead(meant.formula)
    found: Broken = []

    def matches(letters: str, *, comes: bool = True) -> Matches:
        signals: dict[str, Scalar] = {**dict.fromkeys(letters, True), **({"kind": "topic"} if comes else {})}
        made: list[Match] = [None] * len(atoms)
        for test in tests:
            made[test.index] = test.match(signals)
        return made

    for n, step in enumerate(trace.steps):
        time = step.time * SECOND
        before = trace.steps[n - 1]
        after = before.time * SECOND
        while n and not waits and (deadline := engine.next_deadline(after)) is not None and deadline < time:
            engine.mark()
            assert lasts or engine.step(deadline, matches(before.letters, comes=False)) not in NEGATIVE
            engine.back()
            after = deadline
        if shaken:
            engine.mark()
            engine.step(time, matches("pbmcr"))
            engine.step(time + SECOND, matches("qas"))
            engine.back()
            saved = json.loads(json.dumps(engine.snapshot()))
            engine = NativeEngine(meant.formula, meant.time)
            engine.restore(saved)
        negative = engine.step(time, matches(step.letters)) in NEGATIVE
        if not waits:
            found.append({n} if negative else set())
            continue
        owed = engine.owed
        assert owed is not None
        found.append({each.start[1] - 1 for each in owed.decided if each.value == FALSE})
        assert negative is bool(found[-1])
    return found


def check(meant: Meant, trace: Trace, wanted: Broken, text: str) -> None:
    for shaken in (False, True):
        found = judged(meant, trace, shaken=shaken, lasts="always" in text or "never" in text)
        assert found == wanted, f"{text}\n{render(meant.formula, meant.time)}\n{trace}"


def lately(trace: Trace) -> Trace:
    """What held at each step or within 2 s before it."""
    near = [
        [other for other in trace.steps[: n + 1] if step.time - other.time <= 2] for n, step in enumerate(trace.steps)
    ]
    return trace._replace(
        steps=[
            Step(step.time, "".join({letter for other in others for letter in other.letters}))
            for step, others in zip(trace.steps, near, strict=True)
        ]
    )


def unit(most: int, *, timed: bool) -> str:
    return f"{most}s" if timed else f"{most} steps"


@pytest.mark.parametrize("scope", SCOPES)
@pytest.mark.parametrize("pattern", PATTERNS)
@many
@given(
    steps=traces("pqmab"),
    most=st.sampled_from((None, 0, 1, 2, 3)),
    clock=st.sampled_from(("steps", "seconds", "lately")),
)
def test_a_pattern_is_what_it_says(
    scope: str, pattern: str, steps: list[tuple[int, str]], most: int | None, clock: str
) -> None:
    most = None if pattern == "always b" else most
    timed = clock != "steps"
    text = scope + pattern + ("" if most is None else f" within {unit(most, timed=timed)}")
    trace = made(steps, timed=timed)
    meant = read_pattern(text, LATELY if clock == "lately" else NAMES, {}, "seconds" if timed else "steps")
    reading = english.existence_until if (scope, pattern) == ("until q: ", "some b") else PATTERNS[pattern]
    read = lately(trace) if clock == "lately" else trace
    check(meant, trace, reading(read, SCOPES[scope](read), most), text)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("timing", TIMINGS)
@many
@given(
    steps=traces("mcrs"),
    most=st.sampled_from((0, 1, 2, 3)),
    clock=st.sampled_from(("steps", "seconds", "lately")),
    condition=st.sampled_from([*CONDITIONS]),
)
def test_a_requirement_is_what_it_says(
    mode: str, timing: str, condition: str, steps: list[tuple[int, str]], most: int, clock: str
) -> None:
    if timing == "finally" and mode in ENDLESS:
        return
    timed = clock != "steps" and timing != "after"
    length = f" {unit(most, timed=timed)}" if timing in ("for", "within", "after") else ""
    text = f"{mode}{condition}the robot shall {timing}{length} satisfy r"
    trace = made(steps, timed=timed)
    ends = timed and clock == "lately"
    read = lately(trace) if ends else trace
    spans = MODES[mode](read)
    reading: Callable[[Any], Broken] = TIMINGS[timing]
    asked = Asked(read, spans, english.triggers(read, spans, CONDITIONS[condition]), most)
    meant = read_requirement(text, LATELY if ends else NAMES, {}, "seconds" if timed else "steps")
    check(meant, trace, reading(asked), text)


@pytest.mark.parametrize(
    ("text", "letters", "broken"),
    [
        ("after p: no b", "pb", {0}),  # what opens a scope is in it
        ("until q: no b", "qb", set()),  # what closes it is not
        ("after p until q: some b", "p bq", {0}),  # what closes it answers too late
        ("after p until q: no b", "p pq b", {2}),  # what is both leaves open
        ("until q: some b", "q b", {0}),
        ("a causes b", "ab", set()),  # an event answers itself
        ("a causes b within 2 steps", "a  b", set()),  # the last instant counts
        ("a causes b within 2 steps", "a   b", {0}),
        ("a forbids b", "ab", {0}),
        ("b requires a within 1 steps", "a  b", {2}),
        ("some b within 1 steps", " b", set()),
        ("in m, when c the robot shall within 3 steps satisfy r", "mc m  ", set()),  # the end of the scope excuses
        ("in m, when c the robot shall within 1 steps satisfy r", "mc m m", {0}),
        ("in m, when c the robot shall eventually satisfy r", "mc m ", {0}),  # but not what has no time
        ("in m, when c the robot shall for 1 steps satisfy r", "mcr mr m", set()),
        ("in m, when c the robot shall immediately satisfy r", "c mc", {1}),  # what held before the scope begins in it
        ("the robot shall until s satisfy r", "r s ", set()),  # what stops is not asked any more
        ("the robot shall before s satisfy r", "sr", {0}),  # at the same step is not before
    ],
)
def test_what_english_leaves_open_is_chosen(text: str, letters: str, broken: set[int]) -> None:
    read = read_requirement if "shall" in text else read_pattern
    trace = made([(1, each) for each in letters.split(" ")], timed=False)
    found = judged(read(text, NAMES, {}, None), trace)
    assert set().union(*found) == broken
