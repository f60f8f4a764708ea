"""What is skipped of an event's data changes nothing of what a session makes of it."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.events import StreamKey
from oracle_server.core.plan import Plan, StreamPlan, plan
from oracle_server.core.stamps import since_boot_in, stamp_in
from oracle_server.specfiles.load import parse_spec
from oracle_server.wire.data import MAX_EXPONENTS, data_decoder, whole
from oracle_server.wire.errors import WireError
from oracle_server.wire.flat import decode_object
from oracle_server.wire.incoming import MAX_KEYS, MAX_PARTS, QuickEvent, RawEvents
from oracle_server.wire.reading import decode, event_in

SPEC = """
id: odd
streams:
  - topic: /a
    signals:
      plain: msg.a
      deep: msg.b.c.a
      deeper: msg.b.c.a.b + 1.0
      whole: size(msg.c)
      both: "has(msg.a.b) ? msg.a.b : 'none'"
      quoted: msg['a b'].a
      indexed: msg.list[1].a
      some: msg.list.exists(x, x.a == 1)
      same: msg.b == msg.c
      sum: msg.list.map(x, x.b).size()
  - topic: /named
  - {topic: /stamped, stamp: b.c, signals: {v: msg.v}}
  - {topic: /boot, stamp: {field: b.c, unit: us, epoch: boot}, signals: {v: msg.v}}
  - topic: /none
    signals: {}
properties:
  - {id: p, formula: '{a: 1} and {b} and not {c: "x"}'}
"""
NAMES = ["a", "b", "c", "list", "a b", "v", "stamp", "header", "sec", "nanosec", "", "a.b"]
scalars = st.none() | st.booleans() | st.sampled_from([0, 1, 2**40, 1.5, "x", "NaN"]) | st.text(max_size=3)
values = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(NAMES), inner, max_size=5),
)
messages = st.dictionaries(st.sampled_from(NAMES), values, min_size=2, max_size=8)


@pytest.fixture(scope="module")
def odd() -> Plan:
    return plan(parse_spec(SPEC, "odd.yaml").spec)


def made(stream: StreamPlan, data: object) -> Any:
    """All that a session computes from a message."""
    where = stream.spec.stamp
    boot = None if where is None else since_boot_in(data, where)
    return stream.project(data), stream.project.reasons(data), stamp_in(data, where), boot


@settings(max_examples=300, deadline=None)
@given(data=messages, stream=st.sampled_from(["/a", "/named", "/stamped", "/boot", "/none"]))
def test_what_is_skipped_changes_nothing(odd: Plan, data: dict[str, Any], stream: str) -> None:
    ready = odd.streams[StreamKey(stream, "topic")]
    text = json.dumps({"type": "event", "seq": 1, "stream": stream, "data": data})
    full = decode(text, whole)
    part = decode(text, lambda _stream, _kind: data_decoder(ready.decoded))
    assert isinstance(full, QuickEvent)
    assert isinstance(part, QuickEvent)
    assert made(ready, part.data) == made(ready, full.data)


def read(fields: frozenset[str] | None, text: str) -> dict[str, Any]:
    found = decode(f'{{"type":"event","seq":1,"stream":"/a","data":{text}}}', lambda *_: data_decoder(fields))
    assert isinstance(found, QuickEvent)
    return found.data


@pytest.mark.parametrize(
    ("fields", "text", "kept"),
    [
        (["a"], '{"a":{"b":1,"c":2},"b":3}', {"a": {"b": 1, "c": 2}}),
        (["a.b"], '{"a":{"b":1,"c":2},"b":3}', {"a": {"b": 1}}),
        (["a.b", "a"], '{"a":{"b":1,"c":2}}', {"a": {"b": 1, "c": 2}}),
        (["a.b"], '{"a":[1]}', {"a": [1]}),
        (["a.b"], '{"a":1,"a":{"c":1}}', {"a": {}}),
        (["a.b"], '{"a":{"c":1},"a":"x"}', {"a": "x"}),
        (["a"], '{"\\u0061":1}', {"a": 1}),
        ([], '{"a":1}', {}),
        (None, '{"a":{"b":1}}', {"a": {"b": 1}}),
    ],
)
def test_the_fields_that_are_read_are_kept(fields: list[str] | None, text: str, kept: object) -> None:
    assert read(None if fields is None else frozenset(fields), text) == kept


@pytest.mark.parametrize("value", ["[" * 100 + "]" * 100, str(2**70), "1e999"])
def test_what_nobody_reads_is_not_refused(value: str) -> None:
    assert read(frozenset({"v"}), f'{{"v":1,"x":{value}}}') == {"v": 1}
    with pytest.raises(WireError):
        read(frozenset({"x"}), f'{{"v":1,"x":{value}}}')


NESTED = "[" * 60 + "]" * 60
MANY = f"[{','.join([NESTED] * 8_000)}]"
"""480,000 lists in a megabyte, none of them in a key."""


@pytest.mark.parametrize("value", [MANY, f"[{','.join(['{}'] * MAX_PARTS)}]"])
def test_more_lists_and_objects_than_any_message_has_are_refused_where_they_are_read(value: str) -> None:
    assert read(frozenset({"v"}), f'{{"v":1,"x":{value}}}') == {"v": 1}
    for fields in (None, frozenset({"x"})):
        with pytest.raises(WireError, match=f"data: more than {MAX_PARTS} lists and objects") as refused:
            read(fields, f'{{"v":1,"x":{value}}}')
        assert (refused.value.code, refused.value.seq) == ("bad_event", 1)


def test_what_is_like_a_message_is_never_refused_for_its_lists_and_objects() -> None:
    """Each list, and each object but empty ones, stands in a key or has some: more keys are refused before."""
    one = '{"x":[]}'
    crowded = f"[{','.join([one] * (MAX_KEYS - 2))}]"
    assert len(read(None, f'{{"v":{crowded}}}')["v"]) == MAX_KEYS - 2
    brackets = "[{" * MAX_PARTS
    assert read(None, f'{{"v":"{brackets}"}}') == {"v": brackets}
    numbers = f"[{','.join(['1'] * 400_000)}]"
    assert len(read(None, f'{{"v":{numbers}}}')["v"]) == 400_000


def test_each_event_of_a_batch_may_have_as_many() -> None:
    value = f"[{','.join(['[]'] * (MAX_PARTS // 2))}]"
    event = f'{{"type":"event","seq":1,"stream":"/a","data":{{"v":{value}}}}}'
    frame = decode(f'{{"type":"events","events":[{",".join([event] * 3)}]}}')
    assert isinstance(frame, RawEvents)
    for raw in frame.events:
        assert len(event_in(raw, whole).data["v"]) == MAX_PARTS // 2


@pytest.mark.parametrize(
    "odd", ["[" * 63 + "]" * 63, "[" * 64 + "]" * 64, str(2**64 - 1), str(2**64), f'[{{"a":{-(2**63) - 1}}}]']
)
def test_much_data_is_refused_for_what_little_data_is(odd: str) -> None:
    def refusal(text: str) -> str | None:
        try:
            read(None, text)
        except WireError as error:
            return error.message
        return None

    much = ",".join(["[1,2.5]"] * 10_000)
    assert refusal(f'{{"x":{odd},"y":[{much}]}}') == refusal(f'{{"x":{odd}}}')
    assert (refusal(f'{{"x":{odd}}}') is None) == (odd in {"[" * 63 + "]" * 63, str(2**64 - 1)})


@pytest.mark.parametrize("text", ['{"v":1,"x":}', '{"v":1,"x":"\\ud800"}', '{"v":1,"x":NaN}', '{"v":1,"x":01}'])
def test_what_is_no_json_is_refused_wherever_it_is(text: str) -> None:
    with pytest.raises(WireError, match="not JSON"):
        read(frozenset({"v"}), text)


@pytest.mark.parametrize("text", ["[]", "1", "null", '"v"'])
def test_data_is_an_object_whatever_is_read(text: str) -> None:
    with pytest.raises(WireError, match="valid dictionary"):
        read(frozenset(), text)


def many(number: str, count: int) -> str:
    return f"[{','.join([number] * count)}]"


@pytest.mark.parametrize("number", ["1e-310", "9E307", "888888888e+299", "1e-0310", "1.5e-100"])
def test_many_numbers_that_take_long_to_read_are_refused(number: str) -> None:
    """45,000 of them, which is less than a megabyte, took most of a second."""
    text = f'{{"type":"event","seq":3,"stream":"/a","data":{{"a":{many(number, MAX_EXPONENTS + 1)}}}}}'
    with pytest.raises(WireError, match="data: more than 4000 numbers with exponents of three digits") as refused:
        decode(text)
    assert (refused.value.code, refused.value.seq) == ("bad_event", 3)
    with pytest.raises(WireError, match="more than 4000 numbers"):
        decode(text.replace('"event"', '"clock"'))
    with pytest.raises(ValueError, match="more than 4000 numbers"):
        decode_object(text)


@pytest.mark.parametrize("number", ["1e-310", "1.5e-05", "1e23", '"e100"'])
def test_as_many_as_any_message_has_are_read_as_they_are(number: str) -> None:
    count = MAX_EXPONENTS if number == "1e-310" else 2 * MAX_EXPONENTS
    found = decode(f'{{"type":"event","seq":3,"stream":"/a","data":{{"a":{many(number, count)}}}}}')
    assert isinstance(found, QuickEvent)
    assert found.data == {"a": [json.loads(number)] * count}


def test_such_numbers_that_nobody_reads_are_not_refused() -> None:
    text = f'{{"type":"event","seq":3,"stream":"/a","data":{{"v":1,"a":{many("1e-310", 2 * MAX_EXPONENTS)}}}}}'
    found = decode(text, lambda _stream, _kind: data_decoder(frozenset({"v"})))
    assert isinstance(found, QuickEvent)
    assert found.data == {"v": 1}
