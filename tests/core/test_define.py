"""`define:`: names that stand for formulas, with variables or without; what is refused, and in which words."""

from __future__ import annotations

import os
import random

import pytest

from oracle_server.core.errors import FormulaError, SpecError
from oracle_server.core.formula import tree
from oracle_server.core.formula.definitions import Mistake, defined
from oracle_server.core.formula.names import Names
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Atom, Constraint, Formula, Ref
from oracle_server.core.spec import Property
from oracle_server.engines.native import NativeEngine
from oracle_server.specfiles.load import parse_spec
from tests import generate
from tests.core.sessions import A, Feed, open_session
from tests.engines.test_against_brute import SEED
from tests.strategies import free

CASES = int(os.environ.get("CASES", "400"))
SPEC = """id: s
define:
%s
streams:
  - {topic: /odom, signals: {speed: msg.speed}, hold: [speed]}
  - {topic: /pose, signals: {robot: msg.robot, docked: msg.docked}}
properties:
  - id: p
    formula: |
      %s
"""
MOVING = "  moving: '{speed > 0.05}'"
AT = "  at(r): '{topic: /pose, robot: *r, docked}'"


DOUBLED = """  a: 'lasting[1] lasting[1] lasting[1] lasting[1] lasting[1] lasting[1] {docked}'
  b: 'a and a and a and a'
  c: 'b and b and b and b and b'
  d: 'c and c and c and c and c and c and c'"""


def names_of(**definitions: str) -> Names:
    mistakes: list[Mistake] = []
    names = defined({head.replace("__", "(").replace("_X", ")"): text for head, text in definitions.items()}, mistakes)
    assert mistakes == []
    return names


def findings(definitions: str, formula: str) -> list[str]:
    try:
        return [str(finding) for finding in parse_spec(SPEC % (definitions, formula), "s.yaml").warnings]
    except SpecError as error:
        return [str(finding) for finding in error.findings]


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_a_name_is_what_it_stands_for(time: Time) -> None:
    """Names in random places, under quantifiers that would bind what is not meant, and names in names."""
    captured = 0
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"define {time} {number}")
        inner, outer = (generate.formula(rng, time, rng.randint(0, 3), 2, ("r", "q")) for _ in range(2))
        inner, outer = (_using(_using(f, "r"), "q") for f in (inner, outer))
        definitions = {
            "inner(r, q)": render(inner, time),
            "outer(q, r)": f"({render(outer, time)}) and not inner(r, q)",
            "plain": "once {a}",
        }
        mistakes: list[Mistake] = []
        names = defined(definitions, mistakes)
        assert mistakes == []
        one, two = rng.choice(("xy", "yx", "rq", "qr", "xx", "qq", "zr"))
        context = generate.formula(rng, time, 2, 1, tuple(sorted({one, two})))
        text = f"forall[{one}]. forall[{two}]. ({render(context, time)}) or pre outer({one}, {two}) or plain"
        if one == two:
            text = text.replace(f"forall[{one}]. ", "", 1)
        formula = parse_formula(text, time, names)
        whole = tree.And(outer, tree.Not(inner))
        meant: Formula = tree.Or(
            tree.Or(context, tree.Pre(_renamed(whole, {"q": one, "r": two}, 9))), parse_formula("once {a}", time)
        )
        for variable in dict.fromkeys((two, one)):
            meant = tree.Forall(variable, meant)
        assert _renamed(formula, {}) == _renamed(meant, {}), text
        assert parse_formula(render(formula, time, named=True), time, names) == formula
        captured += formula != meant
    assert captured > CASES / 50


def _using(formula: Formula, variable: str) -> Formula:
    return formula if variable in free(formula) else tree.And(formula, Atom((Constraint("a", "==", Ref(variable)),)))


def _renamed(formula: Formula, values: dict[str, str], depth: int = 0) -> Formula:
    """With other free variables, and each quantifier's own named by how deep it stands.

    Formulas that differ in the names of their variables alone become equal.
    """
    if isinstance(formula, Atom):
        return Atom(
            tuple(
                Constraint(c.key, c.op, Ref(values.get(c.value.name, c.value.name))) if isinstance(c.value, Ref) else c
                for c in formula.constraints
            )
        )
    if isinstance(formula, tree.Exists | tree.Forall):
        own = f"own{depth}"
        return type(formula)(own, _renamed(formula.body, {**values, formula.variable: own}, depth + 1))
    return tree.rebuilt(formula, lambda part: _renamed(part, values, depth))


def test_a_name_binds_as_in_parentheses() -> None:
    names = names_of(either="{a} or {b}", every="forall[x]. {c: *x} -> {a}")
    formula = parse_formula("not either and every or {d}", names=names)
    assert formula == parse_formula("(not ({a} or {b}) and (forall[x]. {c: *x} -> {a})) or {d}")
    assert render(formula, named=True) == "not either and every or {d}"


def test_a_bound_of_a_name_counts_what_its_property_counts() -> None:
    names = names_of(lately="once[:5] {a}")
    for time, upper in (("steps", 5), ("seconds", 5 * 10**9)):
        formula = parse_formula("lately", time, names)  # type: ignore[arg-type]
        assert isinstance(formula, tree.Once)
        assert formula.bound.upper == upper


@pytest.mark.parametrize(
    ("definitions", "formula", "says"),
    [
        (
            MOVING,
            "movin -> {docked: *}",
            "s.yaml:10:7: formula of 'p': there is no operator or name `movin`; did you mean",
        ),
        (MOVING, "moving > 3", "s.yaml:10:14: formula of 'p': `moving` stands for a formula"),
        (MOVING, "moving {docked}", "s.yaml:10:14: formula of 'p': `{` is not expected here: between two parts stands"),
        (
            MOVING,
            "moving(r)",
            "with: write `moving`; `moving` is defined at s.yaml:3:3",
        ),
        (AT, "at", "with: write `at(r)`; `at` is defined at s.yaml:3:3"),
        (AT, "at(i)", "s.yaml:10:7: formula of 'p': the variable 'i' is free"),
        (AT, "forall[i]. at(*i)", "s.yaml:10:21: formula of 'p': between the parentheses of a name stand variables"),
        (AT, "at('r1')", "between the parentheses of a name stand variables"),
        (AT, "at()", "between the parentheses of a name stand variables"),
        (
            "  a: 'b'\n  b: '{docked}'",
            "a and b",
            "s.yaml:3:7: definition of 'a': `b` is defined below; a name may use those above",
        ),
        ("  a: 'not a'", "a", "s.yaml:3:11: definition of 'a': `a` is defined by itself here"),
        ("  once: '{docked}'", "{docked}", "s.yaml:3:3: `once` is an operator of formulas; give yours another name"),
        ("  P: '{docked}'", "{docked}", "`P` is an operator of formulas"),
        ("  eventually: '{docked}'", "{docked}", "`eventually` is an operator of formulas"),
        ("  my name: '{docked}'", "{docked}", "s.yaml:3:3: 'my name' is no name: it has letters, digits and `_`"),
        ("  at(r, r): '{robot: *r}'", "{docked}", "the variable `r` of `at` stands there twice"),
        (
            AT + "\n  at: '{docked}'",
            "exists[x]. at(x)",
            "s.yaml:4:3: `at` is defined above, as `at(r)`; give one of them another name",
        ),
        (
            "  at(r): '{docked}'",
            "exists[x]. at(x)",
            "the variable 'r' of `at(r)` is used nowhere: use it as `{id: *r}`",
        ),
        ("  at: '{robot: *r}'", "at", "in front, or name it as a variable of its own: `at(r)`"),
        ("  at: '{robot: '", "at", "s.yaml:3:15: definition of 'at': the formula ends too early"),
        (
            "  at: '{robott: 3, topic: /pose}'",
            "once at",
            "s.yaml:10:12: formula of 'p': unknown signal 'robott'; did you mean `robot`?",
        ),
        (
            "  at: 'once[:5s] {docked}'",
            "at",
            "`at` can't be used with `time: steps`: the bound '5s' is not a number of steps",
        ),
        (
            "  at: {docked: true}",
            "at",
            "found a mapping of docked, since YAML reads `{` itself; put the formula in quotes",
        ),
        ("  at: true", "at", "s.yaml:3:7: `at` must be a text in quotes"),
        (MOVING, "not {docked}", "s.yaml:3:3: warning: `moving` is defined here, and no formula uses it"),
        (
            MOVING + "\n  still: 'not moving'",
            "not {docked}",
            "s.yaml:4:3: warning: `still` is defined here, and no formula uses it",
        ),
        (DOUBLED, "d", "s.yaml:6:7: definition of 'd': the formula has 17,919 parts"),
    ],
)
def test_what_is_wrong_is_told_once_with_its_place(definitions: str, formula: str, says: str) -> None:
    found = findings(definitions, formula)
    assert len(found) == 1, found
    assert says in found[0]


def test_sound_names_are_not_warned_of() -> None:
    assert findings(f"{MOVING}\n{AT}\n  still: 'not moving'", "forall[i]. at(i) -> still or pre moving") == []


def test_names_are_read_where_keys_are_wrong() -> None:
    text = (SPEC % (MOVING, "moving -> movin")).replace("id: s", "id: s\nstrems: []")
    with pytest.raises(SpecError) as refusal:
        parse_spec(text, "s.yaml")
    assert [f.message.partition(";")[0] for f in refusal.value.findings] == [
        "unknown key 'strems'",
        "formula of 'p': there is no operator or name `movin`",
    ]


def test_a_spec_without_names_has_the_digest_that_it_had() -> None:
    plain = SPEC.replace("define:\n%s\n", "") % "{docked}"
    assert (
        parse_spec(plain, "s").spec.digest == parse_spec(plain.replace("id: s", "id: s\ndefine: {}"), "s").spec.digest
    )
    assert parse_spec(SPEC % (MOVING, "moving"), "s").spec.digest != parse_spec(plain, "s").spec.digest


def test_names_can_not_be_used_to_write_without_end() -> None:
    names = names_of(big=" and ".join(["{d}"] * 90), more="(big or big) or (big or big)")
    names.left = 1_500
    assert parse_formula("more", names=names) is not parse_formula("more", names=names)
    with pytest.raises(FormulaError, match="stand for more than 500,000 parts in all"):
        parse_formula("more", names=names)


@pytest.mark.parametrize(
    ("formula", "says"),
    [
        ("not moving", "moving: {speed > 0.05}: holds at step 1 (0.000 s), with speed = 1"),
        ("not once[:5] moving", "once[:5] moving: holds at step 1"),
        ("forall[i]. not at(i)", 'for i = "r1": at("r1"): {robot: "r1", docked}: holds at step 1'),
        ("not busy", "busy: moving and {docked}: holds; moving: {speed > 0.05}: holds at step 1"),
        ("still", "still: not moving: does not hold; moving: {speed > 0.05}: holds at step 1 (0.000 s), with speed"),
        ("not (away and {docked})", 'away: not {robot: "r2"}: holds; {robot: "r2"}: robot = "r1", wanted "r2", at'),
        ("{docked} -> eventually[:0] still", "eventually[:0] still: asked for at step 1"),
        ("{docked} -> next_to", "next_to: eventually[:0] (still or away and pre moving): asked for at step 1"),
        ("forall[i]. at(i) -> done(i)", 'for i = "r1": done("r1"): eventually[:0] {done: "r1"}: asked for at step 1'),
        ("{docked} -> always still", "always still: asked for at step 1 (0.000 s), /a (topic 1 of m); it fails at"),
        ("pre busy", "pre busy: there is no step before"),
        ("not (moving since moving)", "moving since moving: moving holds at step 1"),
        (
            "forall[i]. not once[:2] both(i)",
            'both("r1"): at("r1") and moving: holds; at("r1"): {robot: "r1", docked}: holds',
        ),
    ],
)
def test_explanations_say_the_name(formula: str, says: str) -> None:
    names = names_of(
        moving="{speed > 0.05}", at__r_X="{robot: *r, docked}", busy="moving and {docked}",
        both__r_X="at(r) and moving", still="not moving", away='not {robot: "r2"}',
        done__r_X="eventually[:0] {done: *r}", next_to="eventually[:0] (still or (away and pre moving))",
    )  # fmt: skip
    session = open_session(
        [Property("p", parse_formula(formula, names=names), formula)],
        attach={"m": [A]},
        maker=lambda p: NativeEngine(p.formula, p.time),
        by="arrival",
    )
    (judged,) = Feed(session)(A, 1, {"speed": 1, "docked": True, "robot": "r1"})
    explanation = judged.verdicts[0].explanation
    assert explanation is not None
    assert explanation.formula == formula
    assert says in str(explanation.text)


def test_a_formula_over_numbers_has_no_names() -> None:
    pytest.importorskip("rtamt")
    text = SPEC % (MOVING, "historically[0:5] (moving > 3)") + "    engine: rtamt\n"
    with pytest.raises(SpecError) as refusal:
        parse_spec(text, "s.yaml")
    assert any("has no names; write it over signals" in f.message for f in refusal.value.findings)
