"""Formulas: text to tree and back, what binds tightest, and what is refused, where and with which words."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from oracle_server.core.errors import FormulaError
from oracle_server.core.formula import tree
from oracle_server.core.formula.definitions import defined
from oracle_server.core.formula.parse import MAX_TEXT, Time, parse_formula
from oracle_server.core.formula.render import render, render_atom
from oracle_server.core.formula.size import MAX_DEPTH
from oracle_server.core.formula.tree import Any, Atom, Bound, Constraint, Formula, Once, Ref
from tests import strategies

often = settings(max_examples=250, deadline=None, suppress_health_check=[HealthCheck.too_slow])
times: st.SearchStrategy[Time] = st.sampled_from(("steps", "seconds"))

distances = st.builds(int.__mul__, st.integers(0, 10**9), st.sampled_from((1, 10**3, 10**6, 10**9)))

PIECES = (
    *("(", ")", "{", "}", "[", "]", ":", ",", "*", ".", '"', "'", "->", "!", "&&", "-", "\n", "\x00", "é", "٣"),
    *("not ", "once", " since ", " and ", " or ", "exists[x]. ", "forall[x, y]. ", "true", "inf"),
    *("7", "0.5", "1e999", "ms", "a", "*x", "first", "lasting[", "moving", "at(", "x)", "{v > w}", "< w"),
)
NAMES = defined({"moving": "{a} or {b}", "at(r)": "exists[x]. {a: *r, b: *x}", "broken": "{"}, [])
"""Names that texts may have."""


def flag(key: str) -> Atom:
    return Atom((Constraint(key, "==", value=True),))


def read(text: str, time: Time) -> Formula | None:
    """The formula, None where it is refused, with a place that is in the text."""
    try:
        return parse_formula(text, time, NAMES)
    except FormulaError as error:
        refusal = error
    lines = dict(enumerate(text.split("\n"), 1))
    assert 1 <= refusal.column <= len(lines[refusal.line]) + 1
    return None


def same(left: Formula, right: Formula | None) -> bool:
    """Equal with equal types: 7 is not 7.0 here."""
    return left == right and right is not None and render(left) == render(right)


@often
@given(time=times, data=st.data())
def test_what_is_printed_reads_the_same(time: Time, data: st.DataObject) -> None:
    formula = data.draw(strategies.formulas(time))
    assert same(formula, parse_formula(render(formula, time), time))


@often
@given(lower=distances, upper=st.none() | distances, time=times)
def test_every_bound_prints_and_reads_exactly(lower: int, upper: int | None, time: Time) -> None:
    bound = Bound(lower, None if upper is None else max(lower, upper))
    formula = tree.Since(flag("a"), flag("b"), bound)
    assert parse_formula(render(formula, time), time) == formula


text = st.text(st.characters(exclude_characters='\n"')) | st.text(st.characters(exclude_characters="\n'"))
numbers = st.integers(-(10**38), 10**38) | st.floats(allow_nan=False, allow_infinity=False)
values = text | st.booleans() | numbers | st.just(Any.ANY)


@often
@given(key=text, value=values, number=numbers, op=st.sampled_from(("<", "<=", ">", ">=", "!=")))
def test_every_key_and_value_prints_and_reads_exactly(
    key: str, value: tree.Scalar | Any, number: float, op: strategies.Op
) -> None:
    atom = Atom((Constraint(key, "==", value), Constraint(key, op, number)))
    assert same(atom, parse_formula(render_atom(atom)))


@often
@given(text=st.text(st.characters()), time=times)
def test_any_text_is_read_or_refused(text: str, time: Time) -> None:
    read(text, time)


@often
@given(formula=strategies.formulas(depth=3), time=times, data=st.data())
def test_a_damaged_formula_is_read_or_refused(formula: Formula, time: Time, data: st.DataObject) -> None:
    text = render(formula)
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(text)))
        end = data.draw(st.integers(start, min(len(text), start + 8)))
        text = text[:start] + data.draw(st.sampled_from(("", *PIECES))) + text[end:]
    parsed = read(text, time)
    if parsed is not None:
        assert same(parsed, parse_formula(render(parsed, time), time))


@pytest.mark.parametrize(
    ("text", "meaning"),
    [
        ("not {a} and {b}", "(not {a}) and {b}"),
        ("not once {a}", "not (once {a})"),
        ("once not {a}", "once (not {a})"),
        ("pre pre {a}", "pre (pre {a})"),
        ("once[:3] {a} since {b}", "(once[:3] {a}) since {b}"),
        ("{a} since not {b}", "{a} since (not {b})"),
        ("{a} since {b} since[1:] {c}", "({a} since {b}) since[1:] {c}"),
        ("{a} and {b} since {c}", "{a} and ({b} since {c})"),
        ("{a} since {b} and {c}", "({a} since {b}) and {c}"),
        ("{a} and {b} and {c}", "({a} and {b}) and {c}"),
        ("{a} or {b} or {c} and {d}", "({a} or {b}) or ({c} and {d})"),
        ("{a} -> {b} -> {c}", "{a} -> ({b} -> {c})"),
        ("historically {a} -> once {b}", "(historically {a}) -> (once {b})"),
        ("{a} and exists[x]. {b: *x} or {c}", "{a} and (exists[x]. ({b: *x} or {c}))"),
        ("{a} since exists[x]. {b: *x} and {c}", "{a} since (exists[x]. ({b: *x} and {c}))"),
        ("not forall[x]. {a: *x} -> {b}", "not (forall[x]. ({a: *x} -> {b}))"),
        ("(exists[x]. {a: *x}) -> {b}", "(exists[x]. ({a: *x})) -> {b}"),
        ("exists[x, y]. {a: *x, b: *y}", "exists[x]. (exists[y]. {a: *x, b: *y})"),
        ("!{a} && {b} || {c} -> {d}", "not {a} and {b} or {c} implies {d}"),
        ("P {a} or H {b} or Y {c} or {d} S {e}", "once {a} or historically {b} or pre {c} or {d} since {e}"),
        ("\n once\t[ 1 : 2 ]{ a:1 }\r\n", "once[1:2] {a: 1}"),
        ("once[0:0] {a} or once[0:] {b}", "once[:0] {a} or once {b}"),
    ],
)
def test_binds(text: str, meaning: str) -> None:
    parsed = parse_formula(text)
    assert parsed == parse_formula(meaning)
    assert len(render(parsed)) <= len(meaning), "printed with more parentheses than a reader needs"


@pytest.mark.parametrize(
    ("text", "constraint"),
    [
        ("{k}", Constraint("k", "==", value=True)),
        ("{k: false}", Constraint("k", "==", value=False)),
        ("{k: True}", Constraint("k", "==", "True")),
        ("{k: once}", Constraint("k", "==", "once")),
        ('{"k k" == "a \\ \'b\'"}', Constraint("k k", "==", "a \\ 'b'")),
        ("{k: 'say \"x\"'}", Constraint("k", "==", 'say "x"')),
        ("{k: -7}", Constraint("k", "==", -7)),
        ("{k: 18446744073709551615}", Constraint("k", "==", 2**64 - 1)),
        ("{k != 7e-1}", Constraint("k", "!=", 0.7)),
        ("{since<=-1.5}", Constraint("since", "<=", -1.5)),
        ("{k: *}", Constraint("k", "==", Any.ANY)),
    ],
)
def test_constraint(text: str, constraint: Constraint) -> None:
    parsed = parse_formula(text)
    assert isinstance(parsed, Atom)
    assert parsed == Atom((constraint,))
    assert type(parsed.constraints[0].value) is type(constraint.value)


def test_one_and_true_are_two_constraints() -> None:
    formulas = [parse_formula(text) for text in ("{a: 1}", "{a: true}", "{a: '1'}")]
    assert len(set(formulas)) == len(formulas)


def test_a_variable_may_stand_twice_and_be_bound_again_inside() -> None:
    body = Atom((Constraint("a", "==", Ref("x")), Constraint("b", "==", Ref("x"))))
    expected = tree.Exists("x", tree.And(body, tree.Forall("x", body)))
    assert parse_formula("exists[x]. {a: *x, b: *x} and forall[x]. {a: *x, b: *x}") == expected


@pytest.mark.parametrize(
    ("bound", "lower", "upper"),
    [
        ("[:200ms]", 0, 200_000_000),
        ("[0.2:1.5]", 200_000_000, 1_500_000_000),
        ("[7ns:3us]", 7, 3_000),
        ("[0.5min:1h]", 30 * 10**9, 3_600 * 10**9),
        ("[0.000000001:]", 1, None),
    ],
)
def test_seconds_may_be_decimal_or_carry_units(bound: str, lower: int, upper: int | None) -> None:
    assert parse_formula(f"once{bound} {{a}}", "seconds") == Once(flag("a"), Bound(lower, upper))


@pytest.mark.parametrize(
    ("text", "time", "place", "says"),
    [
        ("", "steps", "1:1", "the formula is empty"),
        ("  \n ", "steps", "1:1", "the formula is empty"),
        ("{a} and\n  {b", "steps", "2:5", "too early"),
        ("{a} xyz", "steps", "1:5", "`xyz` is not expected"),
        ("{a}\nand\n and", "steps", "3:2", "something is missing after `and`"),
        ("{}", "steps", "1:2", "the atom `{}` is empty"),
        ("{a: @}", "steps", "1:5", "`@` is not expected"),
        ("{a: 'x}", "steps", "1:5", "the quote ' is not closed"),
        ("{a > true}", "steps", "1:6", "compares with a number or with another signal, and `true`"),
        ("{a != *}", "steps", "1:7", "compares with a text, a number, true or false, and `*`"),
        ("once[5]{a}", "steps", "1:7", "write `[:5]` for up to 5"),
        ("once[-1:]{a}", "steps", "1:6", "the bound [-1:] can't be read"),
        ("pre[1:2]{a}", "steps", "1:4", "`pre` has no bound"),
        ("notnot {a}", "steps", "1:1", "notnot"),
        ("{a} and\n  once[3:2]{b}", "steps", "2:8", "empty"),
        ("{a} since[2s:1s]{b}", "seconds", "1:11", "empty"),
        ("once[:5ms]{a}", "steps", "1:7", "not a number of steps"),
        ("once[1.5:]{a}", "steps", "1:6", "not a number of steps"),
        ("once[:0.0000000001]{a}", "seconds", "1:7", "finer than a nanosecond"),
        ("once[:1.00000000000000000000000000000000001]{a}", "seconds", "1:7", "finer than a nanosecond"),
        ("once[:1000000001]{a}", "seconds", "1:7", "too large"),
        ("once[:99999999999999999999]{a}", "steps", "1:7", "too large"),
        (f"once[:{'9' * 50}]{{a}}", "steps", "1:7", "too long"),
        ("{a: 1e400}", "steps", "1:5", "too large"),
        (f"{{a: {'9' * 50}}}", "steps", "1:5", "too long"),
        ("{a}\n or {b: *x}", "steps", "2:5", "'x' is free"),
        ("(exists[x]. {a: *x}) and {b: *x}", "steps", "1:26", "'x' is free"),
        ("exists[x]. {a}", "steps", "1:1", "'x' is bound here and used nowhere"),
        ("{c} ->\n forall[y, z]. {b: *z}", "steps", "2:2", "'y' is bound here and used nowhere"),
        ("exists[x]. forall[x]. {a: *x}", "steps", "1:1", "'x' is bound here and used nowhere"),
    ],
)
def test_refused_with_its_place(text: str, time: Time, place: str, says: str) -> None:
    with pytest.raises(FormulaError) as refusal:
        parse_formula(text, time)
    assert str(refusal.value).startswith(f"{place}: ")
    assert says in refusal.value.message


@pytest.mark.parametrize(
    "text",
    [
        "x" * 10_000_000,
        "{a} and " * (MAX_TEXT // 8 - 1) + "{a}",
        "{a} -> " * (MAX_TEXT // 7 - 1) + "{a}",
        "not " * (MAX_TEXT // 4 - 1) + "{a}",
        "!" * (MAX_TEXT - 3) + "{a}",
        "(" * MAX_TEXT,
        "{" * MAX_TEXT,
        "once[" * (MAX_TEXT // 5),
        "{a: " + "9" * (MAX_TEXT - 5) + "}",
        "{a: 1e" + "9" * (MAX_TEXT - 7) + "}",
        "once[:" + "9" * (MAX_TEXT - 10) + "]{a}",
        "exists[" + ",".join(f"v{i}" for i in range(2_000)) + "]. {a: *v0}",
        "'" * MAX_TEXT,
    ],
    ids=lambda text: text[:12],
)
def test_what_is_too_large_or_too_deep_is_refused(text: str) -> None:
    assert read(text, "steps") is None
    assert read(text, "seconds") is None


def test_the_deepest_and_the_widest_that_are_read() -> None:
    deepest = "not " * (MAX_DEPTH - 1) + "{a}"
    assert render(parse_formula(deepest)) == deepest
    assert read("not " + deepest, "steps") is None
    assert parse_formula("(" * 5_000 + "{a}" + ")" * 5_000) == flag("a")
    widest = parse_formula("{" + ", ".join(["a"] * 5_000) + "}")
    assert isinstance(widest, Atom)
    assert len(widest.constraints) == 5_000


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{x} => {y}", "there is no operator `=>`: write `->`"),
        ("{x} <-> {y}", "write `({a} -> {b}) and ({b} -> {a})`"),
        ("finally {x}", "`{cause} -> eventually[:60s] {effect}` for an effect that comes within that bound"),
        ("F[:10s] {x}", "`{cause} -> eventually[:10s] {effect}`"),
        ("{x} -> F_[0,10] {y}", "`{cause} -> eventually[0:10] {effect}`"),
        ("{x} -> F[0,10parsecs] {y}", "`{cause} -> eventually[:60s] {effect}`"),
        ("G[:2.5 sec] {x}", "`{cause} -> always[:2.5s] {effect}`"),
        ("{x} U[<=5] {y}", "write `{start} -> {held} until[:5] {stop}`"),
        ("G {x}", "leave it out, or write `historically`"),
        ("{x} U {y}", "write `{start} -> {held} until[:60s] {stop}`"),
        ("X {x}", "write `next` for the step after"),
        ("{a} -> next[3] {x}", "`next` has no bound"),
        ("{a} -> eventually[2s] {x}", "write `[:2s]` for within 2s"),
        ("{a} -> always[-2:0] {x}", "it counts on from now, without a sign"),
        ("{a} -> eventualy[:3] {x}", "did you mean `eventually`?"),
        ("{x} -> within[:2s] {y}", "a time stands in brackets"),
        ("{a} AND {b}", "there is no operator `AND`: write `and`"),
        ("histoically {a}", "did you mean `historically`?"),
        ("once[:250msec] {x}", "write `[:250ms]`"),
        ("once[:2 s] {x}", "write `[:2s]`, without spaces"),
        ("once[1,5] {x}", "write `[1:5]`"),
        ("once[-2:0] {x}", "without a sign: write `[0:2]`"),
        ("once[-500ms,-1s] {x}", "without a sign: write `[500ms:1s]`"),
        ("once[:-2] {x}", "without a sign: write `[2:]`"),
        ("once[-1:2] {x}", "before is `once[:1] {…}`, and what comes after `{cause} -> eventually[:2] {…}`"),
        ("once[-5:] {x}", "without a sign: write `[:5]`"),
        ("once[2s] {x}", "write `[:2s]` for up to 2s ago, or `[2s:]`"),
        ("once[<=5] {x}", "write `[:5]`"),
        ("once[2..5] {x}", "write `[2:5]`"),
        ("once[0:2parsecs] {x}", "there is no unit 'parsecs'"),
        ("once[] {x}", "leave the brackets out"),
        ("once[0:5 {x}", "is not closed: write `[0:5]`"),
        ("once[0:5) {x}", "is not closed: write `[0:5]`"),
        ("once -5 {x}", "write `once[:5]`"),
        ("once[:5][:3] {x}", "an operator has one bound"),
        ("{a} xor {b}", "`({a} or {b}) and not ({a} and {b})`"),
        ("{v := 1}", "there is no `:=`: write `:`"),
        ("once[x] {x}", "write `[:5]`, `[5:]` or `[2:5]`"),
        ("once(0:2){x}", "stands in square brackets: write `once[0:2]`"),
        ("once{0,2}{x}", "stands in square brackets: write `once[0:2]`"),
        ("once 5s {x}", "stands in square brackets: write `once[:5s]`"),
        ("once<=5 {x}", "in square brackets, as in `once[:5] {…}`"),
        ("pre[1] {x}", "write `pre {…}`"),
        ("pre[3] {x}", "write `once[3:3] {…}`"),
        ("not[3] {x}", "`not` has no bound"),
        ("{v > *x}", "the variable 'x' is free"),
        ("{v > *}", "`>` compares with a number"),
        ("{v != *x}", "write `{v: *} and not {v: *x}`"),
        ("{v < 1,5}", "as `1.5`"),
        ("{v < 1m/s}", "a number has no unit: write it alone, in the unit of the signal, as `v < 1`"),
        ("{v: 0x1F}", "a number is written in decimal digits alone: write `31` for `0x1F`"),
        ("{v < 1_000}", "a number is written in decimal digits alone: write `1000` for `1_000`"),
        ("{v: 0x" + "F" * 5000 + "}", "a number has no unit"),
        ("{d: 90°}", "a number has no unit: write it alone, in the unit of the signal, as `d: 90`"),
        ("{0 < v < 5}", "write `{v > 0, v < 5}`"),
        ("{v > 0 < 5}", "a range is two constraints"),
        ("{m: [A, B]}", "there are no lists in atoms: write `{m: A} or {m: B}`"),
        ("[]{x}", "leave it out, or write `historically`"),
        ("□({x} -> ◇{y})", "no operator `□`: a formula is judged at every step; leave it out"),
        ("{x} -> ◇[0,3] {y}", "no operator `◇`: write `{cause} -> eventually[0:3] {effect}`"),
        ("AG {x}", "leave it out, or write `historically`"),
        ("<>{x}", "`{cause} -> eventually[:60s] {effect}`"),
        ("{x} ~> {y}", "`{cause} -> eventually[:60s] {effect}`"),
        ("once_[0,5] {x}", "there is no operator `once_`: write `once[2:5] {…}`"),
        ("prev {x}", "write `pre`"),
        ("rise({x})", "write `{a} and not pre {a}`"),
        ("{x} for 5s", "`lasting[5s] {a}`"),
        ("{x} 5s ago", "stands in a bound"),
        ("{x} ? {y} : {z}", "write `({a} -> {b}) and (not {a} -> {c})`"),
        ("{cmd_vel.speed > 1}", "write `{topic: /cmd_vel, speed}`"),
        ("{/cmd_vel.speed > 1}", "write `{topic: /cmd_vel, speed > 1}`"),
        ("{topic /cmd_vel}", "write `topic: /cmd_vel`"),
        ("/cmd_vel {x}", "a stream stands in an atom's braces: write `{topic: /cmd_vel}`"),
        ("{v > .5}", "a number is written `0.5`"),
        ("{v > +5}", "a number is written `5`"),
        ("{v <> 5}", "write `!=`"),
        ("{v =! 5}", "write `!=`"),
        ("{v =< 5}", "write `<=`"),
        ("never {x}", "there is no operator `never`: write `not`, which is asked at every step"),
        ("~{x}", "there is no operator `~`: write `not`"),
        ("{x} & {y}", "there is no operator `&`: write `and`"),
        ("{x};", "leave it out"),
        ("{x}, {y}", "between two parts stands"),
        ("{{x}}", "one pair of braces"),
        ("[x > 1]", "write `{x > 1}`"),
        ("'x > 1'", "write `{x > 1}`"),
        ("once {x: $v}", "write `*`"),
        ("{x} # or not", "there are no comments in a formula"),
        ("{x} // or not", "there are no comments in a formula"),
        ("forall x: {v: *x}", "write `forall[x]. {…}`"),
        ("exists x, once {v: *x}", "write `exists[x]. {…}`"),
        ("{x > 3 and f}", "write `{…} and {…}`"),
        ("{not f}", "`not` stands before an atom"),
        ("x > 3", "write `{x > 3}`"),
        ("{3 < x}", "write `{x > 3}`"),
        ("{x => 3}", "write `>=`"),
        ("forall x, y. {v: *x}", "write `forall[x, y]. {…}`"),
        ("forall[x] {v: *x}", "a `.` is missing"),
        ("{a} → {b}", "write `->`"),
        ("{a: “b”}", 'write `"`'),
        ("{x > 3 -> {y}", "`{x > 3 -> {y}` is not closed by `}`"),
        ("({x > 3}", "`({x > 3}` is not closed by `)`"),
        ("{msg.pose.x > 3}", "declare `x: msg.pose.x` under `signals`"),
        ("{x + 1 > 3}", "there is no arithmetic in atoms"),
        ("{a} {b}", "between two parts stands"),
    ],
)
def test_a_mistake_is_told_with_its_mend(text: str, says: str) -> None:
    with pytest.raises(FormulaError) as refusal:
        parse_formula(text, "seconds")
    assert says in refusal.value.message


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("F {x}", "`{cause} -> eventually[:100] {effect}`"),
        ("F[2,10] {x}", "`{cause} -> eventually[2:10] {effect}`"),
        ("F[:60s] {x}", "`{cause} -> eventually[:100] {effect}`"),
        ("G[:2.5] {x}", "`{cause} -> always[:100] {effect}`"),
        ("{x} U {y}", "write `{start} -> {held} until[:100] {stop}`"),
    ],
)
def test_an_operator_of_another_language_is_told_with_a_bound_in_steps(text: str, says: str) -> None:
    with pytest.raises(FormulaError) as refusal:
        parse_formula(text, "steps")
    assert says in refusal.value.message


@settings(max_examples=300, deadline=None, database=None)
@given(st.text(alphabet="{}()[]:,.*<>=!-\"'→abx1 \n", max_size=20))
def test_whatever_can_not_be_read_is_told_at_a_place_within(text: str) -> None:
    error = None
    try:
        parse_formula(text)
    except FormulaError as refused:
        error = refused
    if error is not None:
        assert error.message
        assert 1 <= error.line <= text.count("\n") + 1
        assert 1 <= error.column <= len(text) + 1
