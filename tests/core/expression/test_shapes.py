"""What is said of an expression before any message, where the type of the messages is known, and where it is not."""

from __future__ import annotations

import pytest

from oracle_server.core.expression import Problem, check_shape, parse_expression, result_kind
from oracle_server.core.shapes import Many, Record, Shape, Value

WHOLE, REAL, BOOL, TEXT = (
    Value("whole", "int32"),
    Value("real", "float64"),
    Value("bool", "bool"),
    Value("text", "string"),
)
VECTOR = Record("geometry_msgs/msg/Vector3", {"x": REAL, "y": REAL, "z": REAL})
TIME = Record("builtin_interfaces/msg/Time", {"sec": WHOLE, "nanosec": Value("whole", "uint32")})
TWIST = Record("geometry_msgs/msg/Twist", {"linear": VECTOR, "angular": VECTOR})
SHAPE = Record(
    "my_msgs/msg/All",
    {
        "twist": TWIST,
        "stamp": TIME,
        "count": WHOLE,
        "total": WHOLE,
        "level": Value("whole", "uint8"),
        "levels": Many(Value("whole", "int8")),
        "speed": REAL,
        "on": BOOL,
        "mode": TEXT,
        "blob": Value("bytes", "uint8[]"),
        "ranges": Many(Value("real", "float32")),
        "three": Many(REAL, 3),
        "names": Many(TEXT),
        "points": Many(VECTOR),
    },
)


def found(text: str, shape: Shape | None = SHAPE) -> list[Problem]:
    return check_shape(parse_expression(text), shape)


@pytest.mark.parametrize(
    "text",
    [
        "msg.twist.linear.x * 2 + msg.count",
        "msg.speed == 'NaN' || 'Infinity' == msg.speed",
        "msg.ranges.exists(r, r != 'NaN' && double(r) < 0.5)",
        "msg.speed in ['NaN', 2.5]",
        "msg.ranges.exists(r, r < 0.5) && min(min(msg.ranges), msg.speed) < 'Infinity'",
        "msg.speed * 2 != 'Infinity' && '-Infinity' < msg.speed",
        "msg.points.map(p, p.x).exists(x, x > msg.speed)",
        "msg.points[0].z + msg.three[2]",
        "msg.names.exists(n, n.startsWith('map')) && 'a' in msg.names",
        "msg.count / 2.0 + double(msg.count) / msg.total",
        "msg.count % 2 == 0 ? 'even' : msg.mode",
        "max(msg.ranges) > min(msg.count, msg.speed)",
        "has(msg.mode) && msg.blob == 'AQID' && msg.mode + msg.mode != ''",
        "size(msg.names) > 2 && size(msg.mode) < 3",
        "msg.on == !msg.on",
        "msg.stamp.sec + msg.stamp.nanosec / 1e9 > 3 && msg.stamp.nanosec + 1 > 5",
        "msg.stamp.sec * 1000000000 + msg.stamp.nanosec",
        "msg.mode.trim().lower() == 'idle' || msg.mode.upper().startsWith('ERR') || size(msg.mode.lower()) > 3",
        "msg.on ? msg.count > 1 : unknown()",
        "(msg.count / 4) % 2 == 1 && msg.count / 4 % 2 == 1 && (msg.count / 4 / 2) % (msg.total / 3) == 1",
        "msg.mode in []",
        "todo()",
    ],
)
def test_nothing_is_said_of_what_is_right(text: str) -> None:
    assert found(text) == []
    assert found(text, None) == []


@pytest.mark.parametrize(
    ("text", "column", "says"),
    [
        ("msg.twist.liner.x", 11, "no field `liner`; did you mean `linear`? it has linear, angular"),
        ("has(msg.goal)", 9, "my_msgs/msg/All has no field `goal`"),
        ("'a' + msg.speed", 1, "is a text, and can't be added to `msg.speed`, which is float64; for a text write"),
        ("msg.count.x", 11, "`msg.count` is int32, and has no field `x`"),
        ("msg.ranges['elbow']", 12, "its elements are counted by number from 0, as in `msg.ranges[0]`"),
        ("msg.points.x", 12, "is a list of geometry_msgs/msg/Vector3, and has no field `x`; write `msg.points[0].x`"),
        ("msg.names.length > 2", 11, "write `size(msg.names)`"),
        ("msg.points.exists(p, p.w > 1)", 24, "geometry_msgs/msg/Vector3 has no field `w`"),
        ("msg.ranges.exists(r, r.x > 1)", 24, "`r` is float32, and has no field `x`"),
        ("msg.speed[0]", 11, "`msg.speed` is float64, and no list"),
        ("msg.blob[0]", 10, "and no list; single bytes are not read: compare all of them, as in `msg.blob == 'AQID'`"),
        ("3 in msg.blob", 1, "base64, and no list; single bytes are not read: compare all of them"),
        ("msg.blob.exists(b, b > 3)", 1, "`exists` takes a list; single bytes are not read: compare all of them"),
        ("msg.mode[0]", 10, "and no list; single characters can't be read"),
        ("msg.three[3]", 11, "`msg.three` has 3 elements, the last one is 2"),
        ("msg.names[-1]", 11, "elements are counted from 0"),
        ("msg.mode > 3", 1, "is string and `3`, and `>` takes two numbers or two texts; write '3' in quotes"),
        ("msg.count == '7'", 1, "`msg.count` is int32 and `'7'`, so that this is always false; write 7 without quotes"),
        ("msg.speed == 'fast'", 1, "so that this is always false"),
        ("sqrt(msg.speed) == 'NaN'", 1, "`sqrt(msg.speed)` is computed, and is never the text 'NaN'"),
        ("msg.on == 1", 1, "write `msg.on`"),
        ("msg.on == 'False'", 1, "write `!msg.on`"),
        ("msg.mode in [1, 2]", 1, "no item of the list can match, so that this is always false; write '1' in quotes"),
        ("msg.twist in [msg.count, [msg.on]]", 1, "no item of the list can match, so that this is always false"),
        ("msg.count.lower() == '1'", 1, "`msg.count` is int32, and `lower` takes texts; write `string(msg.count)`"),
        ("msg.mode.trim() && msg.on", 1, "`msg.mode.trim()` is a text, and `&&` takes what is true or false"),
        ("msg.mode * 2", 1, "`msg.mode` is string, and `*` takes numbers; write `double(msg.mode)`"),
        ("msg.on + 1", 1, "`msg.on` is bool, and `+` takes numbers; write `(msg.on ? 1 : 0)`"),
        ("'n' + msg.count", 1, "for a text write `string(msg.count)`"),
        ("msg.names.exists(n, n + 1 > 2)", 21, "`n` is string"),
        ("msg.count && msg.on", 1, "`&&` takes what is true or false; write a comparison, such as `msg.count != 0`"),
        ("!msg.mode", 1, "`!` takes what is true or false"),
        ("msg.mode in msg.mode", 1, "write `msg.mode.contains(msg.mode)`"),
        ("msg.names.contains('a')", 1, "write `'a' in msg.names`"),
        ("msg.count.startsWith('a')", 1, "write `string(msg.count)`"),
        ("msg.speed % 2", 1, "`%` takes whole numbers"),
        ("msg.twist", 1, "a signal is one text, Boolean or number; write one of its fields, such as `msg.tw"),
        ("msg.stamp", 1, "write its seconds as a number, `msg.stamp.sec + msg.stamp.nanosec / 1e9`"),
        ("msg.stamp - 3 > 0", 1, "`-` takes numbers; write its seconds as a number, `msg.stamp.sec + msg.stamp.nan"),
        ("msg.ranges", 1, "`msg.ranges` is a list of float32"),
        ("msg.on ? msg.ranges : msg.names", 10, "`msg.ranges` is a list of float32"),
        ("msg.points.filter(p, p.x > 1)", 1, "is a list"),
        ("msg.twist == 1", 1, "so that this is always false"),
    ],
)  # fmt: skip
def test_what_contradicts_the_type_is_an_error_at_its_place(text: str, column: int, says: str) -> None:
    assert [(p.within, p.severity) for p in found(text)][:1] == [((1, column), "error")]
    assert says in found(text)[0].message
    assert "\n" not in found(text)[0].message


@pytest.mark.parametrize(
    ("text", "shape", "says"),
    [
        ("7 / 2", None, "write `7 / 2.0` for the exact one"),
        ("size(msg.l) / 2 > 1", None, "write `size(msg.l) / 2.0`"),
        ("msg.count / msg.total", SHAPE, "write `double(msg.count) / msg.total`"),
        ("msg.speed + msg.count / 2", SHAPE, "write `msg.count / 2.0`"),
        ("msg.count % 8 / 3 == 1", SHAPE, "write `msg.count % 8 / 3.0`"),
        ("(msg.count + msg.total / 2) % 2 == 1", SHAPE, "write `msg.total / 2.0`"),
        ("msg.count / 0 % 2 == 1", SHAPE, "a division by zero fails"),
        ("1 / 0 == 1", None, "a division by zero fails at every message"),
        ("msg.stamp.sec + msg.stamp.nanosec", SHAPE, "write `msg.stamp.nanosec / 1e9`"),
        ("msg.a.secs - double(msg.l[0].nsecs) > 3", None, "write `double(msg.l[0].nsecs) / 1e9`"),
        ("size(msg.blob)", SHAPE, "counts the characters"),
        ("msg.count // 2", None, "`//` begins a comment"),
    ],
)
def test_what_may_be_meant_otherwise_is_a_warning(text: str, shape: Shape | None, says: str) -> None:
    (problem,) = found(text, shape)
    assert problem.severity == "warning"
    assert says in problem.message


@pytest.mark.parametrize(
    ("text", "column", "says"),
    [
        ("!(msg.on in [false, 0, null])", 21, "the item `0` of the list never matches, as `msg.on` is bool"),
        ("msg.count in [1, 2, '3']", 21, "the item `'3'` of the list never matches, as `msg.count` is int32; write 3"),
        ("msg.count in [1, msg.on]", 18, "never matches, as `msg.count` is int32 and `msg.on` is bool"),
        ("msg.twist in [msg.twist, msg.count]", 26, "the item `msg.count` of the list never matches, as"),
        ("sqrt(msg.speed) in [1.0, 'NaN']", 26, "the item `'NaN'` of the list never matches"),
    ],
)  # fmt: skip
def test_an_item_that_can_not_match_beside_one_that_can_is_doubtful_and_named(
    text: str, column: int, says: str
) -> None:
    (problem,) = found(text)
    assert (problem.within, problem.severity) == ((1, column), "warning")
    assert says in problem.message


@pytest.mark.parametrize(
    ("text", "shape", "column", "says"),
    [
        ("msg.level == 300", SHAPE, 1, "`msg.level == 300` is never true: `msg.level` is uint8, always a"),
        ("msg.on && msg.level == -1", SHAPE, 11, "`msg.level` is uint8, always a whole number from 0 to 255"),
        ("msg.level > 255", SHAPE, 1, "is never true"),
        ("255 < msg.level", SHAPE, 1, "`255 < msg.level` is never true"),
        ("msg.level >= 0", SHAPE, 1, "is always true"),
        ("msg.level != 2.5", SHAPE, 1, "is always true"),
        ("msg.level > 255 && msg.level < 300", SHAPE, 1, "`msg.level > 255` is never true"),
        ("msg.levels.exists(l, l < -128)", SHAPE, 22, "`l < -128` is never true: `l` is int8"),
        ("msg.level in [300, 400]", SHAPE, 1, "`msg.level in [300, 400]` is never true"),
        ("msg.level in [3, 400]", SHAPE, 18, "the item `400` of the list never matches: `msg.level` is uint8"),
        ("size(msg.l) < 0", None, 1, "`size(msg.l)` is always a whole number that is not negative"),
        ("abs(msg.x) < 0", None, 1, "is never true: `abs(msg.x)` is never negative"),
        ("sqrt(msg.x) >= 0.0", None, 1, "is always true: `sqrt(msg.x)` is never negative"),
        ("(msg.data / 4) % 2 == 4", None, 1, "is never true: `(msg.data / 4) % 2` is what is left of a division by 2"),
        ("msg.count % 10 < 10", SHAPE, 1, "is always true: `msg.count % 10` is what is left of a division by 10"),
        ("msg.ranges.exists(r, msg.speed < 0.5)", SHAPE, 22, "reads nothing of `r`, so that `exists` asks the same of"),
        ("msg.mode.lower() == 'FAULT'", None, 1, "is never true: `lower` gives small letters; write `'fault'`"),
        ("msg.mode.upper().trim() != 'Fault'", None, 1, "always true: `upper` gives capital letters; write `'FAULT'`"),
        ("msg.mode.lower().contains('Fault')", None, 1, "write `'fault'`"),
        ("msg.mode.lower() in ['ok', 'Fault']", None, 28, "the item `'Fault'` of the list never matches: `lower`"),
        ("msg.ranges.exists(r, r != r)", SHAPE, 22, "both sides are the same; where NaN is meant, write `r == 'NaN'`"),
        ("msg.ranges.exists(r, r != r)", None, 22, "write `r == 'NaN'`"),
        ("msg.x == msg.x", None, 1, "both sides are the same; where NaN is meant, write `msg.x != "),
        ("msg.count == msg.count", SHAPE, 1, "is always true: both sides are the same"),
        ("msg.ranges.exists(r, string(r) == 'nan')", SHAPE, 22, "its name here is 'NaN'; write `r == 'NaN'`"),
        ("'-inf' != string(msg.speed)", SHAPE, 1, "its name here is '-Infinity'; write `msg.speed != '-Infinity'`"),
    ],
)  # fmt: skip
def test_a_comparison_that_always_comes_to_the_same_is_warned_of(
    text: str, shape: Shape | None, column: int, says: str
) -> None:
    (problem,) = found(text, shape)
    assert (problem.within, problem.severity) == ((1, column), "warning")
    assert says in problem.message


@pytest.mark.parametrize(
    "text",
    [
        "msg.level == 255 || msg.level < 1 || msg.level in [0, 255]",
        "msg.level >= 0 && msg.level <= 255",
        "!(msg.level < 0 || msg.level > 100)",
        "size(msg.names) == 0 || size(msg.names) > 3",
        "msg.mode.lower() == 'fault 7' && msg.mode.upper() != 'É'",
        "msg.mode.lower() == msg.mode || msg.mode == 'FAULT'",
        "string(msg.speed) == 'NaN' || string(msg.speed).lower() == 'nan'",
        "string(msg.speed * 2) == 'inf'",
        "string(msg.mode) == 'nan' || msg.mode == 'nan'",
        "msg.ranges.map(r, r * 2).exists(r, r != r)",
        "msg.speed * 2 == msg.speed * 2",
        "msg.level + 300 > 300",
        "msg.level < msg.level",
        "abs(msg.speed) <= 0.0 || abs(msg.speed) == 0.5",
        "msg.count % 2 == 1 || msg.count % 3 == -2",
        "7 % msg.count == 3",
        "msg.names.exists(n, true)",
        "msg.points.exists(p, msg.ranges.exists(r, r < p.x))",
        "msg.points.map(p, p.x > 1.0, msg.speed)[0] > 2.0",
    ],
)
def test_a_comparison_that_can_come_to_either_is_not_warned_of(text: str) -> None:
    assert found(text) == []


@pytest.mark.parametrize(
    ("text", "mend"),
    [
        ("msg.mode < '20'", "double(msg.mode) < 20"),
        ("'-1.5' <= msg.mode.trim()", "-1.5 <= double(msg.mode.trim())"),
        ("msg.names.all(n, n > '5')", "double(n) > 5"),
        ("msg.mode == '20' || msg.mode != '5'", ""),
        ("msg.mode > 'B2' && msg.mode < '2.x'", ""),
    ],
)
@pytest.mark.parametrize("shape", [SHAPE, None])
def test_a_number_in_quotes_is_compared_letter_by_letter(text: str, mend: str, shape: Shape | None) -> None:
    says = f"texts are compared letter by letter, where '10' comes before '9'; write `{mend}` for numbers"
    assert [(p.severity, says in p.message) for p in found(text, shape)] == ([("warning", True)] if mend else [])


@pytest.mark.parametrize(
    "text", ["'a' < 3", "msg", "msg[0] == 1", "[1, 2]", "msg.l.map(x, x)", "!7", "msg.l[-1]", "true + 1"]
)
def test_what_is_wrong_with_any_message_is_said_of_none(text: str) -> None:
    assert [p.severity for p in found(text, None)] == ["error"]


def test_problems_are_in_the_order_of_the_text_with_lines() -> None:
    assert [p.within for p in found("msg.mode > 1 &&\n  msg.gone == 1 &&\n  7 / 2 == 3")] == [(1, 1), (2, 7), (3, 3)]


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("msg.count", "whole"), ("msg.speed", "real"), ("msg.count * 2.5", "real"), ("msg.count / 2", "whole"),
        ("msg.on", "bool"), ("msg.mode", "text"), ("msg.blob", "bytes"), ("msg.count > 1", "bool"),
        ("msg.on ? 1 : 2", "whole"), ("msg.on ? 1 : 'a'", None), ("string(msg.count)", "text"), ("msg.twist", None),
        ("msg.gone", None), ("size(msg.names)", "whole"), ("max(msg.ranges)", "real"), ("abs(msg.count)", "whole"),
        ("msg.points[0].x", "real"),
    ],
)  # fmt: skip
def test_the_kind_of_a_signal(text: str, kind: str | None) -> None:
    assert result_kind(parse_expression(text), SHAPE) == kind
