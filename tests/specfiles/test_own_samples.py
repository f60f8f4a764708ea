"""What `check` says of a signal beside its own last, least or largest sample, which the very event is one of."""

from __future__ import annotations

import os
import random

import pytest

from oracle_server.core.events import Event, StreamKey
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.verdicts import NEGATIVE
from oracle_server.engines.table import make_engines
from oracle_server.specfiles.load import parse_spec

CASES = int(os.environ.get("CASES", "400"))
SECOND = 10**9
STREAMS = """\
id: t
ordering: {by: arrival}
streams:
  - {topic: /a, signals: {m: msg.m, k: msg.k}}
  - {topic: /b, signals: {k: msg.k}}
"""
HELD = STREAMS.replace("k: msg.k}}\n  - {topic: /b", "k: msg.k}, hold: [m]}\n  - {topic: /b")
DERIVE = "last_m: {last: m}, top: {max: m, over: 3}, low: {min: m, over: 2s}, of_k: {last: m, by: k, forget: 1h}"
IS = "; `last: m` counts the very event, so that `last_m` is `m` wherever both are there; the sample before is `prev"


def told(streams: str, derive: str, formula: str) -> list[str]:
    """The warnings of a property, without their place."""
    text = f"{streams}derive: {{{derive}}}\nproperties: [{{id: p, formula: '{formula}'}}]\n"
    return [str(each).split("warning: ", 1)[1] for each in parse_spec(text, "t.yaml").warnings]


@pytest.mark.parametrize("streams", [STREAMS, HELD])
@pytest.mark.parametrize(
    ("formula", "says"),
    [
        ("not ({m: AUTO} and {last_m: MANUAL})", "it holds at every event, whatever the messages say; it can never be "
         f"violated{IS}"),
        ("not {m: AUTO, last_m: MANUAL}", f"it can never be violated{IS}"),
        ("{topic: /a} -> not {m > last_m}", f"`m > last_m` is never met{IS}"),
        ("not {last_m < m}", f"`last_m < m` is never met{IS}"),
        ("{m: *} -> {m >= last_m}", f"`m >= last_m` is met by every value{IS}"),
        ("forall[v]. {m: *v} -> {last_m: *v}", IS),
        ("not {topic: /a, m > top}", "`m > top` is never met; `max: m` counts the very event, so that `top` is never "
         "less than `m` wherever both are there"),
        ("not {topic: /a, m < low}", "`m < low` is never met; `min: m` counts the very event, so that `low` is never "
         "more than `m` wherever both are there"),
        ("not {topic: /a, m: 1, of_k: 2}", "it can never be violated; `last: m` counts the very event, so that `of_k`"),
    ],
)  # fmt: skip
def test_an_event_is_its_own_last_sample(streams: str, formula: str, says: str) -> None:
    if streams is HELD:  # by each monitor by itself, and the last sample is that of any
        says = says.replace("there; the sample", "there, if one monitor alone sends m; the sample")
    found = [each for each in told(streams, DERIVE, formula) if says in each]
    assert len(found) == 1


@pytest.mark.parametrize(
    ("expression", "says"),
    [
        ("m - last_m", "`m - last_m` is always 0"),
        ("abs(last_m - m) * 2", "`last_m - m` is always 0"),
        ("m != last_m", "`m != last_m` is never true"),
        ("m == last_m ? 1 : 2", "`m == last_m` is always true"),
        ("top < m", "`top < m` is never true; `max: m` counts the very event"),
    ],
)
def test_so_it_is_in_an_expression(expression: str, says: str) -> None:
    found = told(STREAMS, f"{DERIVE}, x: '{expression}'", "{topic: /b} -> not {x: *}")
    assert len([each for each in found if each.startswith(f"derived signal 'x': {says}")]) == 1


@pytest.mark.parametrize(
    ("streams", "formula"),
    [
        (STREAMS, "{topic: /b} -> not {last_m: MANUAL}"),
        (STREAMS, "not ({topic: /b} and {last_m: MANUAL})"),
        (STREAMS, "not {m >= top}"),
        (HELD, "{m: AUTO} -> {k: AUTO}"),
        (HELD, "not ({m: 1} and {of_k: 2})"),  # at /b it may be that of another `k`
        (STREAMS, "not ({m: 1} and not {of_k: 1})"),  # it is absent where `k` is
        (HELD, "not {topic: /b, m > top}"),  # `top` is of the last samples, and `m` may be older than they are
        (HELD, "not {topic: /b, m < low}"),
    ],
)
def test_nothing_is_said_where_another_sample_may_be_meant(streams: str, formula: str) -> None:
    assert not [each for each in told(streams, DERIVE, formula) if "very event" in each]


def test_nothing_is_said_of_the_sample_before() -> None:
    derive = "before: {previous: m}, step: {delta: m}, x: m - before"
    for formula in ("not ({m: AUTO} and {before: MANUAL})", "not {m < before}", "not {step > 2}", "not {x > 2}"):
        assert told(HELD, derive, formula) == []


ATOMS = (
    "{m: 1}", "{m: 2}", "{last_m: 1}", "{last_m: 2}", "{m > last_m}", "{m <= last_m}", "{last_m < m}", "{m > top}",
    "{m < low}", "{m >= low}", "{of_k: 1}", "{of_k: 2}", "{m: 1, last_m: 2}", "{topic: /a}", "{topic: /b}", "{m != 1}",
    "{last_m != 1}", "{top: 1}", "(forall[v]. {m: *v} -> {last_m: *v})", "(exists[v]. {m: *v} and {of_k: *v})",
)  # fmt: skip


def some_formula(rng: random.Random, depth: int) -> str:
    if not depth or rng.random() < 0.2:
        return rng.choice(ATOMS)
    if rng.random() < 0.2:
        return f"not {some_formula(rng, depth - 1)}"
    return f"({some_formula(rng, depth - 1)} {rng.choice(('and', 'or', '->'))} {some_formula(rng, depth - 1)})"


def test_what_is_said_is_so_whatever_comes() -> None:
    claims = {"holds": 0, "fails": 0}
    for number in range(CASES):
        rng = random.Random(f"own sample {number}")
        text = f"{rng.choice((STREAMS, HELD))}derive: {{{DERIVE}}}\nproperties: [{{id: p, formula: '{{}}'}}]\n"
        text = text.replace("'{}'", f"'{some_formula(rng, 3)}'")
        read = parse_spec(text, "t.yaml")
        found = [claim for claim in claims for each in read.warnings if f" it {claim} at every event, " in str(each)]
        if not found:
            continue
        claims[found[0]] += 1
        ready = plan(read.spec)
        session = Session(ready, make_engines(ready))
        for n in range(1, 40):
            now = n * SECOND // 2
            data = {"m": rng.choice((1, 2, 1, 2, None)), "k": rng.choice(("x", "y", None))}
            event = Event(StreamKey(rng.choice(("/a", "/b")), "topic"), "m", n, now, now, data)
            for judged in session.ingest(event):
                assert (judged.verdicts[0].outcome in NEGATIVE) is (found[0] == "fails"), (text, judged)
    assert min(claims.values()) > 2
