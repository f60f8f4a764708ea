"""Predicates of HPL in expressions, against Python; and events of one topic that exclude or imply each other."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.signals import Projection
from oracle_server.specfiles.hpl.cel import cel
from oracle_server.specfiles.hpl.parse import read_properties
from oracle_server.specfiles.hpl.shared import both, implies

Message = Mapping[str, Any]
Said = tuple[str, Callable[[Message], Any]]
"""A part of a predicate, and what it is of a message, in Python."""


def _numbers() -> st.SearchStrategy[Said]:
    leaves: list[Said] = [
        ("x", lambda m: m["x"]),
        ("p.y", lambda m: m["p"]["y"]),
        ("a[0]", lambda m: m["a"][0]),
        ("a[1]", lambda m: m["a"][1]),
        ("len(a)", lambda m: len(m["a"])),
        ("max(a)", lambda m: max(m["a"])),
        ("1", lambda _: 1),
        ("2.", lambda _: 2.0),
        (".5", lambda _: 0.5),
        ("-1", lambda _: -1),
    ]

    def joined(inner: st.SearchStrategy[Said]) -> st.SearchStrategy[Said]:
        def of(a: Said, sign: str, b: Said, bare: bool) -> Said:
            text, python = {
                "+": (f"{a[0]} + ({b[0]})", lambda m: a[1](m) + b[1](m)),
                "-": (f"{a[0]} - ({b[0]})", lambda m: a[1](m) - b[1](m)),
                "*": (f"({a[0]}) * ({b[0]})", lambda m: a[1](m) * b[1](m)),
                "/": (f"({a[0]}) / 4", lambda m: a[1](m) / 4),
                "abs": (f"abs({a[0]})", lambda m: abs(a[1](m))),
            }[sign]
            return (text, python) if bare and sign != "-" else (f"({text})", python)

        return st.builds(of, inner, st.sampled_from(("+", "-", "*", "/", "abs")), inner, st.booleans())

    return st.recursive(st.sampled_from(leaves), joined, max_leaves=3)


_COMPARED: dict[str, Callable[[Any, Any], bool]] = {
    "=": lambda a, b: a == b,
    "!=": lambda a, b: a != b,
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
}


def _compared(a: Said, sign: str, b: Said) -> Said:
    return f"{a[0]} {sign} {b[0]}", lambda m: _COMPARED[sign](a[1](m), b[1](m))


def _ranged(a: Said, low: Said, high: Said, above: bool, below: bool) -> Said:
    text = f"{a[0]} in {'![' if above else '['}{low[0]} to {high[0]}{']!' if below else ']'}"
    lower, upper = _COMPARED[">" if above else ">="], _COMPARED["<" if below else "<="]
    return text, lambda m: lower(a[1](m), low[1](m)) and upper(a[1](m), high[1](m))


def _contained(a: Said, items: list[Said]) -> Said:
    return f"{a[0]} in {{{', '.join(item[0] for item in items)}}}", lambda m: a[1](m) in [i[1](m) for i in items]


NUMBERS = _numbers()
ATOMS: st.SearchStrategy[Said] = st.one_of(
    st.builds(_compared, NUMBERS, st.sampled_from(sorted(_COMPARED)), NUMBERS),
    st.builds(_ranged, NUMBERS, NUMBERS, NUMBERS, st.booleans(), st.booleans()),
    st.builds(_contained, NUMBERS, st.lists(NUMBERS, min_size=1, max_size=3)),
    st.sampled_from(
        [
            ("f", lambda m: m["f"]),
            ("f = False", lambda m: not m["f"]),
            ('s = "it\'s \\"so\\""', lambda m: m["s"] == 'it\'s "so"'),
            ("forall i in a: a[@i] > 0", lambda m: all(v > 0 for v in m["a"])),
            ("exists i in [0 to len(a)]!: a[@i] = x", lambda m: any(v == m["x"] for v in m["a"])),
            ("exists v in {0, x}: @v > p.y", lambda m: any(v > m["p"]["y"] for v in (0, m["x"]))),
        ]
    ),
)


def _conditions() -> st.SearchStrategy[Said]:
    def joined(inner: st.SearchStrategy[Said]) -> st.SearchStrategy[Said]:
        def of(a: Said, word: str, b: Said) -> Said:
            return {
                "and": (f"({a[0]}) and ({b[0]})", lambda m: a[1](m) and b[1](m)),
                "or": (f"({a[0]}) or ({b[0]})", lambda m: a[1](m) or b[1](m)),
                "implies": (f"(({a[0]}) implies ({b[0]}))", lambda m: not a[1](m) or b[1](m)),
                "iff": (f"(({a[0]}) iff ({b[0]}))", lambda m: a[1](m) == b[1](m)),
                "not": (f"not ({a[0]})", lambda m: not a[1](m)),
            }[word]

        return st.builds(of, inner, st.sampled_from(("and", "or", "implies", "iff", "not")), inner)

    return st.recursive(ATOMS, joined, max_leaves=4)


CONDITIONS = _conditions()
MESSAGES = st.fixed_dictionaries(
    {
        "x": st.integers(0, 2),
        "p": st.fixed_dictionaries({"y": st.sampled_from((0, 1.5, -1))}),
        "a": st.lists(st.integers(0, 2), min_size=2, max_size=3),
        "f": st.booleans(),
        "s": st.sampled_from(("", 'it\'s "so"')),
    }
)


@settings(max_examples=100, deadline=None)
@given(CONDITIONS, st.lists(MESSAGES, min_size=1, max_size=8))
def test_a_predicate_is_what_python_makes_of_it(said: Said, messages: list[Message]) -> None:
    text, python = said
    (prop,) = read_properties(f"globally: no /t {{{text}}}", "it.hpl")
    (event,) = prop.behaviour
    assert event.predicate is not None
    project = Projection({"it": cel(event.predicate, "")})
    assert [project(m) for m in messages] == [({"it": bool(python(m))}, frozenset()) for m in messages]


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("not x = 1 and f", "!(msg.x == 1) && msg.f"),
        ("a or b and c implies d or e", "!(msg.a || msg.b && msg.c) || msg.d || msg.e"),
        ("a implies b implies c", "!(!msg.a || msg.b) || msg.c"),
        ("a - b - c = -d * e", "msg.a - msg.b - msg.c == -msg.d * msg.e"),
        ("a - (b - c) < d / 2", "msg.a - (msg.b - msg.c) < msg.d * 1.0 / 2"),
        ("a / (b / c) < 1", "msg.a * 1.0 / (msg.b * 1.0 / msg.c) < 1"),
        ("not x in {1, 2} or f iff g", "(!(msg.x in [1, 2]) || msg.f) == msg.g"),
        ("b[i + 1].c in list", "msg.b[msg.i + 1].c in msg.list"),
        ("forall i in b.c: b.c[@i].d[0] > e", "msg.b.c.all(i, i.d[0] > msg.e)"),
        ("x[0]!= 1", "msg.x[0] != 1"),
        ("x in [0 to b[0]]!", "msg.x >= 0 && msg.x < msg.b[0]"),
        ("r < 2 * PI", "msg.r < 2 * 3.141592653589793"),
    ],
)
def test_operators_bind_as_in_hpl(text: str, wanted: str) -> None:
    (prop,) = read_properties(f"globally: no /t {{{text}}}", "it.hpl")
    assert prop.behaviour[0].predicate is not None
    assert cel(prop.behaviour[0].predicate, "") == wanted


# what one message can be twice

FACTS = st.lists(
    st.sampled_from(
        (
            *("x = 1", "2 = x", "x != 1", "x in {0, 2}", "x in [0 to 1]", "x in ![0 to 1]!", "x > 1", "1 >= x"),
            *("x < 1.5", "not x = 1", "f", "not f", "f = True", "p.y > 0", "p.y = -1", "x > 0.5 or f", "x = p.y"),
        )
    ),
    max_size=3,
)


@settings(max_examples=100, deadline=None)
@given(FACTS, FACTS)
def test_events_that_exclude_or_imply_each_other_do(ours: list[str], theirs: list[str]) -> None:
    braces = [f"{{{' and '.join(f'({part})' for part in parts)}}}" if parts else "" for parts in (ours, theirs)]
    (prop,) = read_properties(f"globally: /t {braces[0]} causes /t {braces[1]}", "it.hpl")
    (one,), (other,) = prop.trigger, prop.behaviour
    said = [cel(e.predicate, "") if e.predicate else "true" for e in (one, other)]
    project = Projection({"one": said[0], "other": said[1]})
    values = [{"x": x, "f": f, "p": {"y": y}} for x in (0, 0.5, 1, 1.25, 2) for f in (True, False) for y in (-1, 0, 1)]
    found = [project(message)[0] for message in values]
    if not list(both((one,), (other,))):
        assert not any(f["one"] and f["other"] for f in found)
    if implies(one, other):
        assert all(f["other"] for f in found if f["one"])
