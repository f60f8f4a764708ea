"""Messages without a time of their own stand at that at which they were published, where the file tells it."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcap.writer import Writer
from rosbags.typesys import Stores, get_typestore

from oracle_server.replay.opening import open_recording
from oracle_server.specfiles.load import load_spec
from tests.replay.judging import BASE, MS, Judgement, judge, write_spec

STORE = get_typestore(Stores.LATEST)
FLOAT = "std_msgs/msg/Float64"
SPEC = """
id: orders
ordering: {max_delay: 500ms}
streams:
  - {topic: /order, type: std_msgs/msg/Float64, signals: {order: msg.data}}
  - {topic: /answer, type: std_msgs/msg/Float64, signals: {answer: msg.data}}
properties: [{id: asked, formula: '{topic: "/answer"} -> once {topic: "/order"}'}]
"""
DAY = 86_400_000
Told = tuple[str, int, int]
"""A message: its topic, when it was recorded, and its publish time, both in ms from the beginning."""


def write(folder: Path, told: list[Told], profile: str = "ros2") -> Path:
    path = folder / "orders.mcap"
    with path.open("wb") as out:
        writer = Writer(out)
        writer.start(profile=profile, library="test")
        schema = writer.register_schema(FLOAT, "ros2msg", b"float64 data\n")
        ids = {topic: writer.register_channel(topic, "cdr", schema) for topic in ("/order", "/answer")}
        raw = bytes(STORE.serialize_cdr(STORE.types[FLOAT](data=1.0), FLOAT))
        for topic, recorded, published in told:
            writer.add_message(ids[topic], BASE + recorded * MS, raw, max(0, BASE + published * MS))
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def judged(folder: Path, told: list[Told], text: str = SPEC) -> Judgement:
    return judge(write_spec(folder, text), write(folder, told))


def stamps(folder: Path, told: list[Told], text: str = SPEC) -> list[int | None]:
    """In ms from the beginning, as the recording has them."""
    events = open_recording(write(folder, told), load_spec(write_spec(folder, text)).spec)
    return [None if r.event.stamp is None else (r.event.stamp - BASE) // MS for r in events]


@pytest.mark.parametrize("profile", ["ros2", ""])
def test_they_are_judged_in_the_order_of_publication(profile: str, tmp_path: Path) -> None:
    path = write(tmp_path, [("/answer", 210, 200), ("/order", 250, 100)], profile)
    found = judge(write_spec(tmp_path, SPEC), path)
    assert (found.exit, found.strict, found.said) == (0, 0, "")
    assert judge(write_spec(tmp_path, SPEC.replace("{max", "{by: arrival, max")), path).exit == 1


@pytest.mark.parametrize(
    ("told", "said"),
    [
        (250, ""),
        (-BASE // MS, ""),  # 0: it is not known
        (250 - DAY - 1, "1 message of which the publish time is needed: it is by another clock"),
        (250 + 1001, "1 message of which the publish time is needed: it is by another clock"),
    ],
)
def test_a_time_by_another_clock_is_not_taken(told: int, said: str, tmp_path: Path) -> None:
    found = judged(tmp_path, [("/answer", 210, 200), ("/order", 250, told)])
    assert said in found.said
    assert bool(said) == bool(found.said)
    assert stamps(tmp_path, [("/answer", 210, 200), ("/order", 250, told)]) == [200, None]
    assert found.exit == 1


def test_a_field_of_the_message_comes_first(tmp_path: Path) -> None:
    told = [("/answer", 210, 200), ("/order", 250, 100)]
    named = SPEC.replace("signals: {order:", "stamp: msg_time, signals: {order:")
    assert stamps(tmp_path, told, named) == [200, None]  # it is missing, which is said
    assert "/order: its only message is ordered by arrival" in judged(tmp_path, told, named).said
    named = SPEC.replace("signals: {order:", "stamp: data, signals: {order:")
    assert stamps(tmp_path, told, named) == [200, (10**9 - BASE) // MS]


LASTING = (
    SPEC.partition("properties")[0]
    + """
derive: {rate: {rate: '{topic: "/answer"}', over: 1s}}
properties:
  - {id: often, time: seconds, formula: 'not {rate < 5}'}
  - {id: answered, time: seconds, formula: '{topic: "/order"} -> eventually[:2s] {topic: "/answer"}'}
  - {id: every, pattern: '/answer every 1s'}
"""
)


def test_what_was_kept_since_before_the_recording_stands_where_it_came(tmp_path: Path) -> None:
    """Else all that nobody recorded would be missing in that hour."""
    answers = [("/answer", at + 1, at) for at in range(0, 5000, 100)]
    assert judged(tmp_path, [("/order", 0, -3_600_000), *answers], LASTING).exit == 0
    assert stamps(tmp_path, [("/order", 0, -501), ("/order", 1, -499)]) == [None, -499]


def test_of_several_publishers_of_a_topic_none_is_late(tmp_path: Path) -> None:
    told = [("/order", at + slow, at) for at in range(0, 100, 10) for slow in (1, 12)]
    told = sorted(told, key=lambda one: one[1])
    assert judged(tmp_path, [("/answer", 0, 0), *told], SPEC.replace("500ms", "1ms")).said == ""
    assert stamps(tmp_path, told) == sorted(stamps(tmp_path, told), key=lambda at: at or 0)
    assert stamps(tmp_path, [("/order", 10, 40), ("/order", 20, 15)]) == [40, 20]  # ahead, and not taken over
