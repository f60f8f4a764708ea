"""`{v > limit}`: two signals compared, at the same step: absent, failed, held, of other types, and in words."""

from __future__ import annotations

import pytest

from oracle_server.core.errors import FormulaError, SpecError
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Any, Atom, Constraint, Signal
from oracle_server.core.session import Session
from oracle_server.core.spec import StreamSpec
from oracle_server.engines.native import NativeEngine
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.load import parse_spec
from tests.core.sessions import A, B, Feed, open_session, outcomes, prop

STREAMS = (
    StreamSpec("/a", signals={"speed": "msg.speed"}),
    StreamSpec("/b", signals={"limit": "msg.limit"}, hold=frozenset({"limit"})),
)


def session_of(formula: str, **more: object) -> Session:
    return open_session(
        [prop("p", formula, **more)],
        attach={"m": [A, B]},
        streams=STREAMS,
        maker=lambda p: NativeEngine(p.formula, p.time),
        by="arrival",
    )


def warned(formula: str, *streams: str) -> list[str]:
    text = "id: s\nstreams:\n" + "".join(f"  - {{{s}}}\n" for s in streams)
    return [
        str(f) for f in parse_spec(f"{text}properties:\n  - id: p\n    formula: |\n      {formula}\n", "s").warnings
    ]


@pytest.mark.parametrize(
    "text", ["{v > limit}", "{v <= limit, flag}", "{a < b, b < c, v > limit}", "{v > limit, limit > 3}"]
)
def test_a_comparison_is_printed_as_it_is_written(text: str) -> None:
    assert render(parse_formula(text)) == text


def test_the_other_signal_must_be_there_too() -> None:
    asked = Constraint("limit", "==", Any.ANY)
    assert parse_formula("{v > limit}") == Atom((Constraint("v", ">", Signal("limit")), asked))
    assert parse_formula("{v > limit, limit: *}") == parse_formula("{v > limit}")
    assert render(parse_formula("{limit: *, v > limit}")) == "{limit: *, v > limit}"


def test_absent_is_false_and_failed_is_unknown() -> None:
    feed = Feed(session_of('{topic: "/a"} -> {speed <= limit}'))
    judged = [
        *feed(A, 1, {"speed": 1}),
        *feed(B, 2, {"limit": 2.5}),
        *feed(A, 3, {"speed": 2.5}),
        *feed(A, 4, {"speed": 3}),
        *feed(A, 5, {"speed": "fast"}),
        *feed(A, 6, {}),
        *feed(B, 7, {"limit": [1]}),
        *feed(A, 8, {"speed": 1}),
    ]
    false, true = "currently_false", "currently_true"
    assert outcomes(judged) == [false, true, true, false, false, false, true, "unknown"], (
        "no event of /b can have a speed"
    )


def test_messages_without_signals_give_the_fields_that_are_compared() -> None:
    session = open_session(
        [prop("p", "{speed <= limit}")],
        attach={"m": [A]},
        streams=[StreamSpec("/a")],
        maker=lambda p: NativeEngine(p.formula, p.time),
        by="arrival",
    )
    assert outcomes(Feed(session)(A, 1, {"speed": 1, "limit": 2})) == ["currently_true"]


@pytest.mark.parametrize(
    ("formula", "says"),
    [
        ('{topic: "/a"} -> {speed <= limit}', "{speed <= limit}: speed = 3, wanted <= limit = 2, at step 2"),
        (
            '{topic: "/a"} -> not {speed > limit}',
            "{speed > limit}: holds at step 2 (0.000 s), with speed = 3, limit = 2",
        ),
        ('{topic: "/b"} -> {speed <= limit}', "{speed <= limit}: `speed` is absent, at step 1"),
        ('{topic: "/b"} -> {limit <= speed}', "{limit <= speed}: `speed` is absent, at step 1"),
        ("once[:0] {speed <= limit}", "none in step 1"),
    ],
)
def test_explanations_tell_both_values(formula: str, says: str) -> None:
    feed = Feed(session_of(formula))
    judged = [*feed(B, 1, {"limit": 2}), *feed(A, 2, {"speed": 3})]
    found = [v.explanation.text for j in judged for v in j.verdicts if v.explanation]
    assert says in str(found[0])


def test_a_failing_comparison_is_plain_data_too() -> None:
    feed = Feed(session_of('{topic: "/a"} -> {speed <= limit}'))
    feed(B, 1, {"limit": 2})
    (why,) = [v.explanation.why for j in feed(A, 2, {"speed": 3}) for v in j.verdicts if v.explanation]
    assert why is not None
    (failing,) = why["reasons"][-1]["failing"]
    assert failing == {"signal": "speed", "op": "<=", "wanted": 2, "value": 3, "than": "limit"}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{v > true}", "1:6: `>` compares with a number or with another signal, and `true` is none"),
        ("{v > NaN}", "1:6: `>` compares with a number or with another signal, and `NaN` is none"),
        ("{v < v}", "1:6: `v` is compared with itself"),
        ("exists[x]. {a: *x} and {v > *x}", "1:24: `v > *x` compares with a variable"),
        ("{v > msg.limit}", "declare `limit: msg.limit` under `signals`, and write `limit`"),
        ("{v > limit + 1}", "there is no arithmetic in atoms"),
        ('{v > "x"}', "`>` compares with a number or with another signal"),
    ],
)
def test_what_can_not_be_compared_is_refused(text: str, says: str) -> None:
    with pytest.raises(FormulaError) as refusal:
        parse_formula(text)
    assert says in str(refusal.value)


NUMBERS = "topic: /a, signals: {v: msg.v, limit: msg.limit}"


@pytest.mark.parametrize(
    "formula",
    [
        "{topic: /a} -> {v <= limit}",
        "{v <= limit} or {v > limit} or not {v: *}",
        "{v > limit} -> not {v > other}",
        "not ({v > limit} and {v < other})",
        "historically ({v: *} -> {v >= limit})",
    ],
)
def test_a_comparison_that_says_something_is_not_warned_of(formula: str) -> None:
    assert warned(formula, "topic: /a, signals: {v: msg.v, limit: msg.limit, other: msg.other}") == []


@pytest.mark.parametrize(
    ("formula", "says"),
    [
        ("{v > limit} and {v <= limit}", "it fails at every event"),
        ("{v: *} -> not {v > limit, limit > v}", "no two numbers meet `v > limit` and `limit > v`"),
        ("{v > limit} -> {v >= limit}", "it holds at every event"),
        ("{v > limit, v: A} or {v: 3}", "no value of `v` meets"),
    ],
)
def test_one_that_says_nothing_is(formula: str, says: str) -> None:
    found = warned(formula, NUMBERS)
    assert found
    assert says in found[0]


@pytest.mark.parametrize(
    ("formula", "says"),
    [
        ("{v > name}", "9:7: formula of 'p': `v > name` compares numbers, and `name` of /a is always a text"),
        ("{name > v}", "9:7: formula of 'p': `name > v` compares numbers, and `name` of /a is always a text"),
        ("{on <= v}", "`on` of /a is always true or false; name two signals that are numbers"),
        ("{v > monitor}", "`monitor` of /a is always a text"),
        ("{v > limt}", "unknown signal 'limt'; did you mean `limit`?"),
        ("{topic: /a, v > far}", "unknown signal 'far'; /a declares"),
    ],
)
def test_texts_and_unknown_names_are_refused(formula: str, says: str) -> None:
    text = f"""id: s
streams:
  - topic: /a
    signals: {{v: msg.v, limit: msg.limit, name: string(msg.n), on: msg.v > 1.0}}
  - {{topic: /b, signals: {{far: msg.far}}}}
properties:
  - id: p
    formula: |
      {formula}
"""
    with pytest.raises(SpecError) as refusal:
        parse_spec(text, "s")
    assert says in str(refusal.value)


def test_they_are_told_beside_other_errors() -> None:
    text = """id: s
define: {odd: '{v > name}'}
streams:
  - {topic: /a, signals: {v: msg.v, name: string(msg.n)}}
properties:
  - {id: p, formula: 'pre odd'}
  - {id: q, formula: '{w: 3}'}
"""
    with pytest.raises(SpecError) as refusal:
        parse_spec(text, "s")
    assert [str(f).partition(":")[2][:30] for f in refusal.value.findings] == [
        "6:27: formula of 'p': `v > nam",
        "7:23: formula of 'q': unknown ",
    ]
    assert refusal.value.findings[0].message.endswith("; `odd` is defined at s:2:10")


def test_a_text_of_one_stream_does_not_refuse_the_number_of_another() -> None:
    assert warned("{v > limit}", NUMBERS, "topic: /b, signals: {v: string(msg.v), limit: msg.limit}") == []


@pytest.mark.parametrize(
    ("limit", "said"), [("size(msg.data) > 0 ? msg.data[0] : 'none'", 0), ("size(msg.data) > 0 ? msg.data[0] : 0", 1)]
)
def test_a_number_is_neither_below_nor_above_what_may_be_a_text(limit: str, said: int) -> None:
    text = f"""id: s
streams:
  - {{topic: /cmd, type: geometry_msgs/msg/Twist, signals: {{v: msg.linear.x}}}}
  - {{topic: /limit, type: std_msgs/msg/Float64MultiArray, signals: {{limit: "{limit}"}}, hold: [limit]}}
properties:
  - {{id: p, formula: '{{topic: /cmd, limit: *}} -> {{v <= limit}} or {{v > limit}}'}}
"""
    found = parse_spec(text, "s", types=Types(environment={})).warnings
    assert ["it holds at every event" in f.message for f in found] == [True] * said
