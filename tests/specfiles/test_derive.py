"""What `check` says of derived signals: each mistake at its place, and what to write; and nothing of what is right."""

from __future__ import annotations

import pytest

from oracle_server.core.errors import SpecError
from oracle_server.specfiles.load import parse_spec

SPEC = """\
id: t
streams:
  - {topic: /scan, signals: {near: msg.n}}
  - {topic: /cmd, signals: {speed: msg.v, user: string(msg.u)}}
  - {topic: /limit, signals: {limit: msg.v}, hold: [limit]}
derive:
  rate: {rate: '{topic: /scan}', over: 2s}
  age: {age: '{topic: /scan}'}
  total: {sum: speed, over: 10s, by: user}
  DERIVED
properties:
  - {id: p, formula: 'FORMULA'}
"""


def told(derived: str = "other: limit", formula: str = "{topic: /cmd} -> {rate >= 10}", more: str = "") -> list[str]:
    """What is said of a derived signal on line 10, and of a formula on line 12."""
    text = SPEC.replace("DERIVED", derived).replace("FORMULA'", f"{formula}'{more}")
    try:
        found = parse_spec(text, "s.yaml").warnings
    except SpecError as error:
        found = tuple(error.findings)
    return [f"{f.line}:{f.column} {'' if f.severity == 'error' else 'warning: '}{f.message}" for f in found]


@pytest.mark.parametrize(
    ("derived", "place", "says"),
    [
        ("m: limit - spead", "10:14", "unknown signal 'spead'; did you mean `speed`?"),
        ("m: msg.x - 1", "10:6", "a derived signal has no `msg`"),
        ("m: limit.x", "10:12", "signals have no fields"),
        ("m: {sum: m, over: 2s}", "10:12", "'m' can't be computed of itself"),
        ("m: age * 2", "10:6", "'age' is an age, which changes all the time"),
        ("m: {max: age, over: 2s}", "10:12", "'age' is an age"),
        ("m: {sum: speed}", "10:7", "`sum` is taken over a window: write `over: 2s`, or `over: 20` for samples"),
        ("m: {last: speed, over: 2s}", "10:20", "`last` has no window"),
        ("m: {rate: '{topic: /scan}', over: 20}", "10:31", "a rate is how many there are a second"),
        ("m: {sum: speed, over: 200000}", "10:25", "a window holds at most 100,000 samples, not 200,000"),
        ("m: {sum: speed, over: 0}", "10:25", "a window has at least 1 sample"),
        ("m: {sum: speed, over: 0s}", "10:25", "a window is longer than 0s"),
        ("m: {sum: user, over: 2s}", "10:12", "`sum` takes numbers, and 'user' is never one"),
        ("m: {sum: speed, min: speed, over: 2s}", "10:6", "it is one of sum, min, and not several"),
        ("m: {over: 2s}", "10:6", "it says not what it is"),
        ("m: {count: 'once {topic: /scan}', over: 2s}", "10:20", "`count` takes what holds at one step"),
        ("m: {count: '{topic: /scam}', over: 2s}", "10:15", "did you mean `/scan`?"),
        ("m: {count: '{topic: /scan', over: 2s}", "10:28", "is not closed by `}`"),
        ("m: {sum: speed, over: 2s, by: usr}", "10:33", "unknown signal 'usr'; did you mean `user`?"),
        ("m: {sum: speed, over: 2s, forget: 2s}", "10:29", "`forget` is for what is kept `by` a signal"),
        ("m: {sum: speed, over: 2s, by: user, forget: 2s}", "10:39", "a window forgets by itself"),
        ("m: {last: speed, by: user}", "10:24", "write `forget: 1h`"),
        ("m: {sum: speed, windw: 2s}", "10:19", "unknown key 'windw'"),
        ("m: 5", "10:6", "such as {rate: '{topic: /scan}', over: 2s}, or an expression; found 5"),
        ("topic: limit", "10:10", "the signal 'topic' is reserved"),
        ("near: limit", "10:9", "'near' is a signal of /scan already"),
        ("null: limit", "10:9", "`null` is a word of expressions"),
        ('"in": limit', "10:9", "`in` is a word of expressions; give the derived signal another name"),
    ],
)
def test_a_derived_signal_is_refused_at_its_place(derived: str, place: str, says: str) -> None:
    (first, *_) = told(derived)
    assert first.startswith(f"{place} "), first
    assert says in first


def test_each_may_use_those_above_it() -> None:
    assert told("m: later + 1\n  later: limit")[0].startswith(
        "10:6 derived signal 'm': 'later' is derived further down"
    )
    assert told("later: limit\n  m: later + 1") == []


@pytest.mark.parametrize(
    ("formula", "says"),
    [
        ('{rate: "x"}', "`{rate: \"x\"}` is never met: 'rate' is a number"),
        ("{rate: true}", "`{rate}` is never met: 'rate' is a number"),
        ("forall[x]. {age: *x} -> once {topic: /cmd}", "binds another value at every instant"),
        ("{rat >= 10}", "unknown signal 'rat'"),
    ],
)
def test_what_a_formula_asks_of_them_can_be_met(formula: str, says: str) -> None:
    (first, *_) = told(formula=formula.replace("'", "''"))
    assert says in first
    assert first.startswith("12:")


def test_an_age_in_a_formula_over_numbers_is_told_in_its_own_words() -> None:
    (first, *_) = told(formula="age < 1", more=", engine: rtamt")
    assert "'age' is an age, which changes at every instant, and a formula over numbers is judged at steps" in first
    assert first.endswith("leave `engine` out, and compare it with a number, as `{age < 0.5}`")


def test_a_rate_that_is_demanded_before_it_is_known_is_warned_of() -> None:
    (warned,) = told(formula="{rate >= 10}", more=", time: seconds")
    assert warned.startswith("12:23 warning: formula of 'p': `{rate >= 10}` is false in the first 2s of a session")
    assert warned.endswith("write `not {rate < 10}`")


@pytest.mark.parametrize(
    "formula",
    [
        "not {rate < 10}",
        "{age <= 0.5}",
        "{topic: /cmd} -> {age <= 0.5, other > 1}",
        "{topic: /cmd} -> not {total > 5}",
        "{total <= 5} or not {total: *}",
        "forall[u]. {user: *u, total > 5} -> pre once {user: *u}",
        "historically not {rate < 1}",
        "once {rate >= 10}",
        "{rate: *} -> {rate >= 10}",
        "{topic: /scan} -> pre {age < 1}",
    ],
)
def test_nothing_is_said_of_what_is_right(formula: str) -> None:
    assert told(formula=formula, more=", time: seconds") == []


def test_a_spec_without_derived_signals_means_what_it_did() -> None:
    plain = "id: t\nstreams: [{topic: /a}]\nproperties: [{id: p, formula: '{topic: /a}'}]\n"
    assert parse_spec(plain, "s").spec.digest == parse_spec(plain + "derive: {}\n", "s").spec.digest
    more = parse_spec(plain + "derive: {m: monitor}\n", "s").spec.digest
    assert more != parse_spec(plain, "s").spec.digest
    first, second = (
        parse_spec(plain + f"derive: {{{d}}}\n", "s").spec.digest for d in ("a: kind, b: kind", "b: kind, a: kind")
    )
    assert first != second


def test_two_signals_are_compared_where_time_turns_nothing_between_steps() -> None:
    timed = SPEC.replace("formula: 'FORMULA'", "time: seconds, formula: '{topic: /cmd} -> {speed <= COMPARED}'")
    for name in ("rate", "age", "total", "limit"):
        assert not parse_spec(timed.replace("COMPARED", name).replace("DERIVED", "other: limit"), "s.yaml").warnings
    assert told(formula="{topic: /cmd} -> {speed <= total}") == []


def test_what_is_defined_stands_in_derived_signals_too() -> None:
    named = SPEC.replace("derive:", "define:\n  fast: '{speed > limit}'\nderive:")
    named = named.replace("DERIVED", "n: {count: fast, over: 2s}").replace("FORMULA", "{topic: /cmd} -> {n < 3}")
    assert not parse_spec(named, "s.yaml").warnings


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("fast", ""),
        ("rate", "`rate` is a derived signal, too: `{rate}` would not be `rate`; give one of them another name"),
        ("speed(u)", "`speed` is a signal of /cmd, too: `{speed}` would not be `speed`; give one of them another name"),
        ("limit", "`limit` is a signal of /limit, too"),
        ("kind", "`kind` is a signal of all events, too: `{kind}` would not be `kind`; give yours another name"),
    ],
)
def test_a_defined_name_is_that_of_no_signal(name: str, says: str) -> None:
    body = "{user: *u, speed > limit}" if "(" in name else "{speed > limit}"
    named = SPEC.replace("derive:", f"define:\n  {name}: '{body}'\nderive:").replace("DERIVED", "n: limit")
    use = name.replace("(u)", "(x)")
    formula = f"forall[x]. {{user: *x, n > 1}} -> {use}" if "(" in name else f"{use} or {{n > 1}}"
    try:
        found = parse_spec(named.replace("FORMULA", formula), "s.yaml").warnings
    except SpecError as error:
        found = tuple(error.findings)
    assert [f"{f.line}:{f.column}" for f in found] == (["7:3"] if says else [])
    assert all(says in f.message for f in found)
    assert [f"; the first is at s.yaml:{line}" in str(f) for f in found for line in ("4", "5", "8", "9", "10")].count(
        True
    ) == (says != "" and name != "kind")


def test_late_events_are_put_in_their_places_among_derived_signals() -> None:
    text = SPEC.replace("DERIVED", "m: limit").replace("FORMULA", "{topic: /cmd} -> {rate >= 10}")
    assert parse_spec(f"{text}ordering: {{late: revise}}\n", "s.yaml").spec.ordering.late == "revise"
