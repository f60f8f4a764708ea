"""What people are told: of an expression that can't be read, with its place and a mend; of a signal that has failed."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.errors import ExpressionError
from oracle_server.core.expression import check_shape, idle, parse_expression
from oracle_server.core.expression.values import NO_ORDER
from oracle_server.core.signals import DefaultProjection, Projection


@pytest.mark.parametrize(
    ("text", "place", "says"),
    [
        ("msg.a = 3", (1, 7), "write `==`"),
        ("msg.a > 1 and msg.b", (1, 11), "write `&&` for `and`"),
        ("msg.a or msg.b", (1, 7), "write `||` for `or`"),
        ("not msg.a", (1, 1), "write `!` for `not`"),
        ("not(msg.a)", (1, 1), "write `!` for `not`"),
        ("msg.a == True", (1, 10), "write `true` for `True`"),
        ("msg.a is None", (1, 7), "write `!has(msg.a)`"),
        ("'open", (1, 1), "no closing quote"),
        ("(msg.a > 3", (1, 1), "the `(` that opens here is not closed"),
        ("msg.a > 3)", (1, 10), "this `)` closes nothing"),
        ("msg.l[0", (1, 6), "the `[` that opens here is not closed"),
        ("data > 3", (1, 1), "write `msg.data` for the field"),
        ("mgs.data > 3", (1, 1), "did you mean `msg`?"),
        ("msg.mode == auto", (1, 13), "write `msg.auto` for the field, or 'auto' for the text"),
        ("msg.state == IDLE", (1, 14), "the number that its .msg file gives for `IDLE`, or 'IDLE' for the text"),
        ("msg.mode == SafetyMode.NORMAL", (1, 13), "the number that its .msg file gives for `NORMAL`"),
        ("msg.state in [px4_msgs.msg.VehicleStatus.ARMED]", (1, 15), "that its .msg file gives for `ARMED`"),
        ("msg.state == VehicleStatus::ARMED", (1, 14), "the number that its .msg file gives for `ARMED`"),
        ("STATE_IDLE > 3", (1, 1), "constants of a message's type are not read: write the number that"),
        ("msg.x^2", (1, 6), "write `msg.x * msg.x`"),
        ("(msg.x & 4) != 0", (1, 8), "whether a bit is set, here that of 4, is asked by `(msg.data / 4) % 2"),
        ("msg.x | 0x04", (1, 7), "there are no bit operators"),
        ("msg.x ^ 4", (1, 7), "there are no bit operators"),
        ("msg.x << 2", (1, 7), "there are no bit operators"),
        ("msg.x >> 2 == 1", (1, 7), "there are no bit operators"),
        ("msg.a > 1 & msg.b", (1, 11), "write `&&` for 'and'"),
        ("msg.x ** 2", (1, 7), "write `msg.x * msg.x`"),
        ("2 * -(msg.x + 1) ** 3", (1, 18), "write `(msg.x + 1) * (msg.x + 1) * (msg.x + 1)`"),
        ("msg.x ** 0.5", (1, 7), "write `sqrt(msg.x)`"),
        ("msg.a is not None", (1, 7), "write `has(msg.a)`"),
        ("msg.a == None", (1, 7), "write `!has(msg.a)`"),
        ("msg.a is not 3", (1, 7), "write `!=` for `is not`"),
        ("msg.a not in [1, 2]", (1, 7), "write `!(msg.a in [1, 2])`"),
        ("math.sqrt(msg.x)", (1, 1), "there is no `math`: write `sqrt(msg.x)`"),
        ("std::abs(msg.x)", (1, 1), "there is no `std`: write `abs(msg.x)`"),
        ("msg.x * math.pi", (1, 9), "write the number, 3.141592653589793"),
        ("np.linalg.norm(msg.x)", (1, 1), "there is no `np`"),
        ("msg.x * 1.0f", (1, 9), "'1.0f' is no number; a number has neither a unit nor a type"),
        ("msg.a > 1 AND msg.b", (1, 11), "write `&&`"),
        ("speed = msg.x", (1, 1), "leave `speed =` out"),
        ("lambda m: m.x", (1, 1), "write what it computes alone"),
        ('f"{msg.x}"', (1, 1), "put texts together by `+`"),
        ("(float) msg.x", (1, 2), "write `double(msg.count)`"),
        ("/cmd_vel.linear.x", (1, 1), "write `msg.field`, without the stream's name"),
        ("msg.z * 180 / pi", (1, 15), "write the number, 3.14"),
        ("prev(msg.x)", (1, 1), "what was before is asked in a formula"),
        ("msg.get('x')", (1, 5), "a field stands behind a dot"),
        ("sin(msg.x)", (1, 1), "let a node compute it"),
        ("len(msg.l) > 2", (1, 1), "write `size(msg.list)`"),
        ("msg.s.strip() == 'on'", (1, 7), "write `msg.text.trim()`"),
        ("msg.s.lowerAscii() == 'on'", (1, 7), "write `msg.text.lower()`"),
        ("lower(msg.s) == 'on'", (1, 1), "stands behind the text: write `msg.text.lower()`"),
        ("todo('later')", (1, 1), "'todo' is written `todo()`"),
        ("msg.todo()", (1, 5), "write `todo()`"),
        ("sizes(msg.l)", (1, 1), "did you mean `size`?"),
        ("msg.s.startswith('a')", (1, 7), "startsWith"),
        ("contains(msg.s, 'a')", (1, 1), "write `msg.text.contains('part')`"),
        ("msg.x.abs()", (1, 7), "write `abs(msg.x)`"),
        ("timestamp('x') == 1", (1, 1), "no times"),
        ("duration('1s') == 1", (1, 1), "no times"),
        ("bytes(msg.a) == 1", (1, 1), "base64"),
        ("b'a' == msg.a", (1, 1), "base64"),
        ("msg.l.exists(x > 3)", (1, 14), "write `msg.list.exists(x, x > 0)`"),
        ("msg.l[0:2]", (1, 8), "no parts of lists"),
        ("msg.a if msg.b else 1", (1, 7), "`test ? value : otherwise`"),
        ("msg.a ? 1", (1, 10), "`:` is missing"),
        ("3m > msg.a", (1, 1), "'3m' is no number"),
        ("msg.a in (1, 2)", (1, 12), "square brackets"),
        ("msg.a &&\n  msg.b >", (2, 10), "a value is missing after `>`"),
        ("msg.a msg.b", (1, 7), "an operator is missing"),
        ("msg.s.matches('a(')", (1, 15), "a '(' is not closed"),
        ("msg.a == \u201con\u201d", (1, 10), "is no quote here"),
        ("'a\\d' == msg.a", (1, 3), "is no character"),
        ("msg.position[msg.name.indexOf('hip')] > 1", (1, 23), "the stream has `each: msg.name`"),
        ("msg.list.find(x, x.name == 'a').x", (1, 10), "write `msg.list.exists(x, x.name == 'a' && x.x > 0)`, or"),
        ("msg.list.last()", (1, 10), "write `msg.list[size(msg.list) - 1]` for the last element"),
        ("isNaN(msg.x)", (1, 1), "write `msg.x == 'NaN'`"),
        ("parseInt(msg.text)", (1, 1), "or `int(msg.text)`"),
        ("exists(msg.x)", (1, 1), "write `has(msg.field)`"),
        ("yaw(msg.orientation)", (1, 1), "is the cosine of the tilt"),
        ("", (1, 1), "the expression is empty"),
        ("#", (1, 1), "means nothing here"),
    ],
)  # fmt: skip
def test_a_slip_is_told_with_its_place_and_a_mend(text: str, place: tuple[int, int], says: str) -> None:
    with pytest.raises(ExpressionError) as raised:
        parse_expression(text)
    assert says in raised.value.message
    assert (raised.value.line, raised.value.column) == place
    assert "\n" not in raised.value.message


NO_ELEMENT = (
    "an index takes a list and a whole number; "
    "uint8[] arrives as a text in base64, of which all is compared, as in msg.data == 'AQID'"
)
MESSAGE = {"n": 7, "zero": 0, "s": "NaN", "l": [1, 2], "m": {"k": 1}, "b": True, "none": None, "large": 2**64}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("msg.s * 2", "msg.s * 2 is nan, and a signal is a text, a Boolean or a finite number"),
        ("msg.s > 2.0", f"msg.s is 'NaN': {NO_ORDER}"),
        ("msg.s <= msg.n", f"msg.s is 'NaN' and msg.n is 7: {NO_ORDER}"),
        ("min(msg.n, msg.s)", f"min(msg.n, msg.s) with nan: {NO_ORDER}"),
        ("msg.b * 2", "msg.b is true: `*` takes numbers"),
        ("msg.b > 2.0", "msg.b is true: `>` takes two numbers or two texts"),
        ("7 / 0", "7 / 0: division by zero"),
        ("msg.n / msg.zero", "msg.n is 7 and msg.zero is 0: division by zero"),
        ("1 + 2 * (msg.n % msg.zero)", "msg.n is 7 and msg.zero is 0: division by zero"),
        ("msg.l[5]", "msg.l is a list of 2: it has no such element"),
        ("msg.s[0] > 3", f"msg.s is 'NaN': {NO_ELEMENT}"),
        ("msg.n.lower()", "msg.n is 7: `lower` takes a text before it"),
        ("msg.n > 3 && todo()", "todo(): it is still to be written"),
        ("unknown()", "unknown(): it is said to be unknown"),
        ("msg.n.x", "msg.n.x with 7: it has no fields"),
        ("sqrt(-msg.n)", "-msg.n is -7: a negative number has no square root"),
        ("msg.l.all(x, x)", "msg.l.all(x, x) with 1: `all` takes what is true or false of each element"),
        ("msg.s", "msg.s is 'NaN', and a signal is a text, a Boolean or a finite number"),
        ("msg.l", "msg.l is a list of 2, and a signal is a text, a Boolean or a finite number"),
        ("msg.m", "msg.m is a message, and a signal is a text, a Boolean or a finite number"),
        ("msg.large", f"msg.large is {2**64}, and a whole number has at most 64 bits as a signal"),
        ("msg.n / 0.0", "msg.n / 0.0 is inf, and a signal is a text, a Boolean or a finite number"),
    ],
)
def test_a_failed_signal_has_its_reason(text: str, says: str) -> None:
    projection = Projection({"v": text, "sound": "msg.n", "absent": "msg.none > 1"})
    assert projection.reasons(MESSAGE) == {"v": says}


def test_a_failed_field_has_its_reason() -> None:
    assert list(DefaultProjection(["s", "n"]).reasons(MESSAGE)) == ["s"]
    assert Projection({"v": "msg.n"}).reasons("no message") == {}


scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=4) | st.just(10**400)
values = st.recursive(
    scalars, lambda v: st.lists(v, max_size=3) | st.dictionaries(st.sampled_from("abx"), v, max_size=3)
)
PIECES = [
    "msg",
    "msg.a",
    "msg.b.x",
    "msg['a']",
    ".",
    "(",
    ")",
    "[",
    "]",
    "{",
    "}",
    "?",
    ":",
    ",",
    "+",
    "-",
    "*",
    "/",
    "%",
    "!",
    "&&",
    "||",
    "==",
    "!=",
    "<",
    ">=",
    "in",
    "1",
    "2.5",
    "1u",
    "'a'",
    '"b"',
    "r'c'",
    "'\\n",
    "x",
    "has(",
    ".size()",
    "size(",
    ".exists(x,",
    ".map(x,",
    ".filter(x,",
    ".all(x,",
    "abs(",
    "max(",
    "sqrt(",
    "string(",
    "double(",
    "int(",
    ".matches('a*')",
    ".contains(",
    "true",
    "false",
    "null",
    "//",
    "#",
    "=",
    "and",
    "'",
    "é",
]
FUNCTIONS = ["abs", "double", "int", "max", "min", "size", "sqrt", "string", "uint"]
MARKS = ["+", "-", "*", "/", "%", "==", "!=", "<", ">=", "in", "&&", "||"]


@settings(max_examples=400, deadline=None)
@given(
    pieces=st.lists(st.sampled_from(PIECES) | st.text(max_size=2), max_size=12),
    message=st.dictionaries(st.sampled_from("ab"), values),
)
def test_nothing_else_is_raised_whatever_is_written(pieces: list[str], message: dict[str, object]) -> None:
    text = " ".join(pieces)
    try:
        projection = Projection({"v": text})
    except ExpressionError as error:
        lines = text.splitlines() or [""]
        refused = error
    else:
        evaluated(projection, text, message)
        return
    assert refused.message
    assert refused.column >= 1
    assert 1 <= refused.line <= len(lines) + 1


@settings(max_examples=300, deadline=None)
@given(
    outer=st.sampled_from([*FUNCTIONS, "", "!", "-"]),
    mark=st.sampled_from(MARKS),
    inner=st.sampled_from(["msg.b", "msg.b.x", "msg.b[0]", "2.5", "7", "'a'", "msg.a.map(x, x)", "msg.a.exists(x, x)"]),
    message=st.dictionaries(st.sampled_from("ab"), values),
)
def test_nothing_is_raised_whatever_the_message_is(
    outer: str, mark: str, inner: str, message: dict[str, object]
) -> None:
    text = f"{outer}(msg.a {mark} {inner})"
    evaluated(Projection({"v": text}), text, message)
    evaluated(Projection({"v": f"msg.a {mark} {outer}({inner})"}), text, message)


@pytest.mark.parametrize("huge", [10**5000, -(10**5000)], ids=["large", "small"])
def test_a_number_beyond_all_bounds_raises_nothing(huge: int) -> None:
    message: dict[str, object] = {"a": huge, "l": [huge, 1.5]}
    calls = [f"{name}(msg.a)" for name in FUNCTIONS] + [
        "max(msg.a, 2.5)",
        "min(msg.l)",
        "-msg.a",
        "!msg.a",
        "msg.l[msg.a]",
    ]
    marks = [
        f"{one} {mark} {other}"
        for mark in MARKS
        for one, other in (("msg.a", "2.5"), ("7", "msg.a"), ("msg.a", "msg.l"))
    ]
    for text in (*calls, *marks, "msg.a", "msg.a ? 1 : 2", "msg.l == [msg.a]", "msg.l.exists(x, x > 2.0)"):
        evaluated(Projection({"v": text}), text, message)


def evaluated(projection: Projection, text: str, message: dict[str, object]) -> None:
    signals, failed = projection(message)
    assert set(projection.reasons(message)) == failed
    assert not any(isinstance(v, float) and not math.isfinite(v) for v in signals.values())
    check_shape(parse_expression(text), None)


@pytest.mark.parametrize("text", ["3.14 / 2", "-1", "-(2)", "1 + 2 * -3.5", "'open'", "true", "msg.x > 3", "todo()"])
def test_a_number_computed_of_numbers_is_meant(text: str) -> None:
    assert idle(parse_expression(text)) is None


@pytest.mark.parametrize("text", ["3 > 2", "'a' + 'b'", "!true", "sqrt(2)", "min(3, 0.5) + 0.4", "true && false"])
def test_what_else_reads_nothing_of_the_message_is_told(text: str) -> None:
    assert idle(parse_expression(text)) == f"`{text}` reads nothing of the message, and is the same at each one"
