"""What a broken or hostile client may send: it is told, loses nothing that was taken, and harms nobody else."""

from __future__ import annotations

import json

import pytest

from tests.whole.client import attached, good, make_event, seqs
from tests.whole.harness import Server

pytestmark = pytest.mark.usefixtures("bystander")

EVENT = '{"type":"event","seq":1,"stream":"/a","stamp":1732147200000000000,"data":%s}'
FIELD = '{"type":"event","seq":1,"stream":"/a","stamp":1732147200000000000,"data":{},%s}'


MALFORMED = {
    "nothing": "",
    "blank": "  ",
    "no_json": "hello",
    "half": '{"type":"event","seq":1',
    "two": '{"type":"detach"}{"type":"detach"}',
    "byte_order_mark": '\ufeff{"type":"detach"}',
    "single_quotes": "{'type':'detach'}",
    "null": "null",
    "true": "true",
    "number": "17",
    "text": '"event"',
    "list": '[{"type":"detach"}]',
    "empty": "{}",
    "no_type": '{"stream":"/a","data":{}}',
    "type_null": '{"type":null}',
    "type_number": '{"type":1}',
    "type_list": '{"type":["event"]}',
    "type_object": '{"type":{"event":1}}',
    "type_unknown": '{"type":"shutdown"}',
    "type_unknown_with_seq": '{"type":"later","seq":1}',
    "type_long": '{"type":"%s"}' % ("x" * 10_000),
    "nan": EVENT % '{"v":NaN}',
    "infinity": EVENT % '{"v":-Infinity}',
    "overflow": EVENT % '{"v":1e999}',
    "seq_overflow": '{"type":"event","seq":1e999,"stream":"/a","data":{}}',
    "seq_long": '{"type":"event","seq":' + "9" * 100_000 + ',"stream":"/a","data":{}}',
    "lone_surrogate": EVENT % '{"v":"\\ud800"}',
    "control_character": EVENT % '{"v":"\x00"}',
    "deep_lists": EVENT % ('{"v":' + "[" * 1000 + "]" * 1000 + "}"),
    "deep_objects": EVENT % ('{"v":' * 1000 + "1" + "}" * 1000),
    "deeper_lists": EVENT % ('{"v":' + "[" * 100_000 + "]" * 100_000 + "}"),
    "deeper_objects": EVENT % ('{"v":' * 100_000 + "1" + "}" * 100_000),
    "open_lists": "[" * 1_000_000,
    "batch_null": '{"type":"events","events":null}',
    "batch_object": '{"type":"events","events":{"0":{}}}',
    "batch_missing": '{"type":"events"}',
    "batch_deep": '{"type":"events","events":' + "[" * 100_000 + "]" * 100_000 + "}",
    "clock_missing": '{"type":"clock"}',
    "clock_empty": '{"type":"clock","stamps":[{}]}',
    "clock_negative": '{"type":"clock","stamps":[{"stream":"/a","stamp":-1}]}',
    "clock_huge": '{"type":"clock","stamps":[{"stream":"/a","stamp":9223372036854775808}]}',
    "clock_float": '{"type":"clock","stamps":[{"stream":"/a","stamp":1.5}]}',
    "clock_kind": '{"type":"clock","stamps":[{"stream":"/a","kind":"tick","stamp":1}]}',
    "outcome_missing": '{"type":"outcome"}',
    "outcome_why": '{"type":"outcome","seq":1,"passed":true,"why":"mood"}',
    "outcome_passed": '{"type":"outcome","seq":1,"passed":1,"why":"decision"}',
    "attach_wrong": '{"type":"attach"}',
}


@pytest.mark.parametrize("text", MALFORMED.values(), ids=MALFORMED)
async def test_what_is_no_message_is_told_and_uses_up_no_number(server: Server, session: str, text: str) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send_text(text)
        await monitor.expect("error", code="malformed")
        await good(monitor, 1)
    assert seqs(server, session) == [1]
    assert server.get(f"sessions/{session}")["counters"]["refused"] == 0


REFUSED = {
    "no_stream": '{"type":"event","seq":1,"data":{}}',
    "no_data": '{"type":"event","seq":1,"stream":"/a"}',
    "data_null": EVENT % "null",
    "data_list": EVENT % "[1]",
    "data_text": EVENT % '"hello"',
    "data_number": EVENT % "1",
    "nested_65": EVENT % ('{"v":' + "[" * 64 + "]" * 64 + "}"),
    "integer_of_65_bits": EVENT % '{"v":18446744073709551616}',
    "negative_of_65_bits": EVENT % '{"v":[{"w":-9223372036854775809}]}',
    "integer_of_4000_digits": EVENT % ('{"v":' + "9" * 4000 + "}"),
    "stream_null": '{"type":"event","seq":1,"stream":null,"data":{}}',
    "stream_number": '{"type":"event","seq":1,"stream":1,"data":{}}',
    "stream_long": '{"type":"event","seq":1,"stream":"%s","data":{}}' % ("/a" * 10_000),
    "kind_unknown": FIELD % '"kind":"gaol"',
    "goal_without_id": FIELD % '"kind":"goal"',
    "goal_id_long": FIELD % f'"kind":"goal","goal_id":"{"g" * 256}"',
    "goal_id_number": FIELD % '"kind":"cancel","goal_id":1',
    "result_without_status": FIELD % '"kind":"result","goal_id":"a"',
    "status_unknown": FIELD % '"kind":"status","goal_id":"a","status":"asleep"',
    "kind_null": FIELD % '"kind":null',
    "stamp_negative": '{"type":"event","seq":1,"stream":"/a","stamp":-1,"data":{}}',
    "stamp_huge": '{"type":"event","seq":1,"stream":"/a","stamp":9223372036854775808,"data":{}}',
    "stamp_float": '{"type":"event","seq":1,"stream":"/a","stamp":1732147200000000000.5,"data":{}}',
    "stamp_text": '{"type":"event","seq":1,"stream":"/a","stamp":"1732147200000000000","data":{}}',
    "stamp_object": '{"type":"event","seq":1,"stream":"/a","stamp":{"sec":1,"nanosec":0},"data":{}}',
    "ask_number": FIELD % '"ask":1',
    "ask_null": FIELD % '"ask":null',
    "source_number": FIELD % '"source":7',
    "call_negative": FIELD % '"call":-1',
    "call_text": FIELD % '"call":"1"',
    "lost_negative": FIELD % '"lost":-1',
    "lost_huge": FIELD % '"lost":9007199254740992',
    "lost_float": FIELD % '"lost":0.5',
}


@pytest.mark.parametrize("text", REFUSED.values(), ids=REFUSED)
@pytest.mark.parametrize("batched", [False, True], ids=["alone", "batched"])
async def test_a_bad_event_is_refused_by_its_number(server: Server, session: str, text: str, batched: bool) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        if batched:
            later = json.dumps(make_event(2, data={"v": 11}))
            await monitor.send_text('{"type":"events","events":[' + text + "," + later + "]}")
        else:
            await monitor.send_text(text)
            await monitor.send(make_event(2, data={"v": 11}))
        await monitor.expect("error", code="bad_event", seq=1)
        await monitor.acked(2)
        await good(monitor, 3)
    records = server.records(session)
    assert [(r["seq"], r["outcome"], r["degraded"]) for r in records] == [
        (2, "currently_false", True),
        (3, "currently_true", True),
    ]
    assert server.get(f"sessions/{session}")["counters"]["refused"] == 1


@pytest.mark.parametrize(
    "seq", ["0", "-1", "1.0", "1.5", '"1"', "true", "null", "[1]", "{}", "9007199254740992", str(10**30)]
)
async def test_an_event_without_a_sound_number_is_refused(server: Server, session: str, seq: str) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send_text('{"type":"event","seq":' + seq + ',"stream":"/a","data":{}}')
        frame = await monitor.expect("error", code="bad_event")
        assert "seq" not in frame
        await good(monitor, 1)
    assert seqs(server, session) == [1]


SOUND = {
    "nested_64": '{"v":' + "[" * 63 + "]" * 63 + "}",
    "integer_of_64_bits": '{"v":18446744073709551615}',
    "negative_of_64_bits": '{"v":-9223372036854775808}',
    "largest_float": '{"v":1.7976931348623157e308}',
    "smallest_float": '{"v":5e-324}',
    "minus_zero": '{"v":-0.0}',
    "nan_as_text": '{"v":"NaN"}',
    "null_character": '{"v":"\\u0000","\\u0000":1}',
    "emoji": '{"v":"\\ud83d\\ude00"}',
    "no_key": '{"":{"":""}}',
    "key_twice": '{"v":11,"v":1}',
    "stamp_of_wrong_type": '{"stamp":"now","header":{"stamp":[1]}}',
    "stamp_far_away": '{"stamp":1e300,"header":{"stamp":{"sec":1e300,"nanosec":-5}}}',
    "long_text": '{"v":"%s"}' % ("x" * 900_000),
    "many_keys": json.dumps({f"k{i}": i for i in range(40_000)}),
    "unknown_fields": '{},"future":{"field":1}',
}


@pytest.mark.parametrize("data", SOUND.values(), ids=SOUND)
@pytest.mark.parametrize("spec", ["single", "texts"])
async def test_odd_data_is_judged(server: Server, session: str, data: str, spec: str) -> None:
    async with attached(server, session=session, spec=spec) as monitor:
        await monitor.send_text('{"type":"event","seq":1,"stream":"/a","data":' + data + "}")
        await monitor.acked(1)
        await good(monitor, 2)
    assert seqs(server, session) == [1, 2]


async def test_a_value_that_is_no_signal_makes_the_verdict_unknown(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        for seq, v in enumerate((1, [1], {"w": 1}, "NaN", None, 1), start=1):
            await monitor.send(make_event(seq, at=seq, data={"v": v}))
        await monitor.acked(6)
    assert [(r["outcome"], r["degraded"]) for r in server.records(session)] == [
        ("currently_true", False),
        *[("unknown", degraded) for degraded in (False, True, True)],
        *[("currently_true", True)] * 2,
    ]


async def test_numbers_that_go_back_or_jump_are_judged_once(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        numbers = (1, 1, 3, 2, 3, 1, 7, 6, 2**40)
        await monitor.send(*(make_event(seq, at=place, data={"v": 1}) for place, seq in enumerate(numbers)))
        await monitor.acked(2**40)
    found = [r["seq"] for r in server.records(session)]
    assert len(found) == len(set(found))
    assert {1, 3, 7, 2**40} <= set(found) <= set(numbers)
    assert server.get(f"sessions/{session}")["monitors"][0]["next"] == 2**40 + 1
