"""Times that can't be read or meant are said, and are no strict success; lines that are no events are told plainly."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from oracle_server.core.errors import TraceError
from tests.replay.judging import BASE, judge, write_numbers, write_spec

SPEC = """
id: timed
streams:
  - {{topic: /a, {stamp}signals: {{v: msg.v}}}}
properties:
  - {{id: low, formula: '{{topic: "/a"}} -> {{v < 5}}'}}
"""
S = 10**9


def spec(folder: Path, stamp: str = "", text: str = SPEC) -> Path:
    return write_spec(folder, text.format(stamp=stamp and f"stamp: {stamp}, "))


def log(folder: Path, *lines: dict[str, Any] | str, name: str = "log.txt") -> Path:
    path = folder / name
    path.write_text("".join((line if isinstance(line, str) else json.dumps(line)) + "\n" for line in lines))
    return path


def flat(time: Any, **fields: Any) -> dict[str, Any]:
    return {"topic": "a", "time": time, "v": 1, **fields}


def own(arrived: Any = None, stamp: Any = None, **fields: Any) -> dict[str, Any]:
    times = {"arrived": arrived, "stamp": stamp}
    return {
        "stream": "/a",
        **{k: v for k, v in times.items() if v is not None},
        "data": {"v": 1, **fields},
    }


FLAT: dict[str, tuple[Any, str]] = {
    "text": ("now", "`time` is 'now', and no time in seconds since 1970"),
    "a number in a text": ("12.5", "`time` is '12.5', and no time in seconds since 1970"),
    "an object of other fields": ({"secs": 1, "nanosecs": 5}, "`time` is a message, and no time in seconds"),
    "nanoseconds": (BASE, f"`time` is {BASE}, and no time in seconds since 1970"),
    "milliseconds": (BASE // 10**6, "`time` is 1732147200000, and no time in seconds since 1970"),
    "negative": (-5.0, "`time` is -5.0, and no time in seconds since 1970"),
    "zero": (0, "`time` is 0, and no time in seconds since 1970"),
    "null": (None, "it has no time of arrival"),
    "a boolean": (True, "`time` is true, and no time"),
}


@pytest.mark.parametrize("case", FLAT)
def test_a_time_of_a_log_that_can_not_be_read_is_said(case: str, tmp_path: Path) -> None:
    time, said = FLAT[case]
    path = log(tmp_path, flat(1.5), flat(2.5), flat(time), flat(3.5), flat(time))
    found = judge(spec(tmp_path), path)
    assert (found.exit, found.strict) == (0, 3)
    (note,) = found.summary["notes"]
    assert note.startswith(f"{path}:3: {said}")
    assert note.endswith(": it counts as arrived with the line before (2 such lines)")


def test_where_the_first_time_can_not_be_read_none_counts_and_that_is_said(tmp_path: Path) -> None:
    found = judge(spec(tmp_path), log(tmp_path, flat("now"), flat(2.5), flat(3.5)))
    assert (found.exit, found.strict) == (0, 3)
    assert ":1: `time` is 'now', and no time in seconds since 1970: the line has no time" in found.said
    assert ":2: the first line has no time of arrival: that of the line does not count (2 such lines)" in found.said


OWN: dict[str, tuple[list[dict[str, Any]], str, str]] = {
    "no time of arrival": ([own(1), own(), own(3)], "", ":2: it has no time of arrival: it counts as arrived with"),
    "earlier than before": ([own(9 * S), own(5 * S)], "", ":2: it arrived before the line above it: it counts as"),
    "a stamp in seconds": (
        [own(BASE, BASE // S)],
        "",
        f":1: `stamp` is {BASE // S}, which are seconds: it is taken for nanoseconds",
    ),
    "all in seconds": (
        [own(stamp=BASE // S), own(stamp=BASE // S + 60)],
        "",
        "its times look like seconds, and are taken for nanoseconds: all lie within 60 ns",
    ),
    "all in milliseconds": ([own(BASE // 10**6), own(BASE // 10**6 + 60_000)], "", "its times look like milliseconds"),
    "all in microseconds": (
        [own(BASE // 1000), own(BASE // 1000 + 65 * 10**6)],
        "",
        "its times look like microseconds, and are taken for nanoseconds: all lie within 65000000 ns",
    ),
    "twenty minutes in milliseconds": ([own(BASE // 10**6), own(BASE // 10**6 + 1_200_000)], "", "like milliseconds"),
    "a stamp in microseconds": (
        [own(BASE, BASE // 1000)],
        "",
        f":1: `stamp` is {BASE // 1000}, which are microseconds: it is taken for nanoseconds",
    ),
    "a stamp in milliseconds": ([own(BASE, BASE // 10**6)], "", "which are milliseconds: it is taken for nanoseconds"),
    "no time beside times": ([own(stamp=1), own()], "", "no time passes where none is said: 1 line of 2"),
    "a time in the message": ([own(), own(header={"stamp": 2})], "", "no time passes where none is said: 1 line of 2"),
    "a field like a time": (
        [{"topic": "/a", "v": 1, "stamp": 1.5}, {"topic": "/a", "v": 1, "timestamp": 2.5}],
        "",
        "1 line of 2; `timestamp` is not read as one: name it in the spec, with its unit, as "
        "`stamp: {field: timestamp, unit: s}` of its stream",
    ),
    "a misspelt key": (
        [{"stream": "/a", "arived": 1, "data": {"v": 1}}] * 2,
        "",
        ":1: the key `arived` is not read (did you mean `arrived`?): what it says does not count (2 such lines)",
    ),
    "a text in the stamp": (
        [own(1, header={"stamp": "today"})],
        "",
        ":1: /a: `header.stamp` is 'today', and no time: it is ordered by the time of its line",
    ),
    "an odd stamp": (
        [own(1, header={"stamp": {"seconds": 5}})],
        "",
        ":1: /a: `header.stamp` is seconds 5, and no time",
    ),
    "a negative stamp": (
        [own(1, header={"stamp": {"sec": -5, "nanosec": 0}})],
        "",
        ":1: /a: `header.stamp` is sec -5 and nanosec 0, and no time",
    ),
    "nanoseconds for the spec's seconds": ([own(1, t=BASE)], "t", f":1: /a: `t` is {BASE}, and no time"),
    "the spec's field is missing": ([own(1, t=5), own(2)], "t", ":2: /a: it has no `t`: it is ordered by the time of"),
    "the spec's field is null": ([own(1, t=None)], "{field: t, unit: ms}", ":1: /a: it has no `t`"),
    "since boot": ([own(1, t="x")], "{field: t, unit: us, epoch: boot}", ":1: /a: `t` is 'x', and no time"),
}


@pytest.mark.parametrize("case", OWN)
def test_a_time_that_can_not_be_meant_is_said(case: str, tmp_path: Path) -> None:
    lines, stamp, said = OWN[case]
    found = judge(spec(tmp_path, stamp), log(tmp_path, *lines))
    assert (found.exit, found.strict) == (0, 3)
    assert said in found.said


RIGHT: dict[str, tuple[list[dict[str, Any]], str]] = {
    "other keys": ([own(1) | {"comment": "a", "robot": "b"}], ""),
    "no times at all": ([own(), own()], ""),
    "times from 1 on": ([own(1, 1), own(2, 2)], ""),
    "seconds, and ROS times": ([flat(1.5), flat({"secs": 2, "nsecs": 5}), flat({"sec": 3, "nanosec": 5})], ""),
    "zero": ([own(1, header={"stamp": {"sec": 0, "nanosec": 0}}), own(2, header={"stamp": 0})], ""),
    "zero where the spec has it": ([own(1, t=0)], "t"),
    "since boot": ([own(1, t=5), own(2, t=6)], "{field: t, unit: us, epoch: boot}"),
    "a simulation's stamps": ([own(BASE, S), own(BASE + S, 2 * S)], ""),
    "a little earlier": ([own(9 * S), own(9 * S - 5)], ""),
    "the line's own stamp": ([own(1, 1, header={"stamp": "today"}), own(2, 2)], "t"),
}


@pytest.mark.parametrize("case", RIGHT)
def test_times_that_are_right_are_no_matter(case: str, tmp_path: Path) -> None:
    lines, stamp = RIGHT[case]
    found = judge(spec(tmp_path, stamp), log(tmp_path, *lines))
    assert (found.exit, found.strict, found.said) == (0, 0, "")


PER_SECOND = {"us": 10**6, "ms": 10**3, "ns": S, "s": 1}
NAMES = {"us": "microseconds", "ms": "milliseconds", "ns": "nanoseconds", "s": "seconds"}
TICKS = range(0, 6 * S, S // 10)


@pytest.mark.parametrize(("meant", "taken"), [("us", "ns"), ("ms", "ns"), ("us", "ms"), ("s", "ms"), ("ms", "us")])
def test_stamps_since_boot_in_another_unit_are_said(meant: str, taken: str, tmp_path: Path) -> None:
    lines = [own(BASE + at, t=(100 * S + at) * PER_SECOND[meant] / S) for at in TICKS]
    found = judge(spec(tmp_path, f"{{field: t, unit: {taken}, epoch: boot}}"), log(tmp_path, *lines))
    assert (found.exit, found.strict) == (0, 3)
    assert f": `t` looks like {NAMES[meant]}, and is taken for {NAMES[taken]}" in found.said
    assert "/a: its stamps span " in found.said
    assert ", and its arrivals 5.9 s: " in found.said


@pytest.mark.parametrize("unit", PER_SECOND)
def test_stamps_in_their_unit_are_no_matter(unit: str, tmp_path: Path) -> None:
    lines = [own(BASE + at, t=(100 * S + at) * PER_SECOND[unit] / S) for at in TICKS]
    found = judge(spec(tmp_path, f"{{field: t, unit: {unit}, epoch: boot}}"), log(tmp_path, *lines))
    assert (found.exit, found.strict, found.said) == (0, 0, "")


AT_ODD_RATES: dict[str, list[tuple[int, int]]] = {
    "latched": [(at, S) for at in TICKS],
    "latched, and set twice": [(at, S if at < 3 * S else 1000 * S) for at in TICKS],
    "replayed slowly": [(at, at // 100 + 1) for at in TICKS],
    "replayed fast": [(at, at * 50 + 1) for at in TICKS],
    "replayed with a pause": [(at if at < 3 * S else at + 6000 * S, at + 1) for at in TICKS],
    "in bursts": [(at // S * S + at // 10**5, at + 1) for at in TICKS],
    "a clock that was set": [(at, at + (1 if at < 2 * S else 6000 * S)) for at in TICKS],
    "few": [(0, 1), (5 * S, 5 * S // 1000)],
}


@pytest.mark.parametrize("case", AT_ODD_RATES)
def test_stamps_at_other_rates_are_in_their_unit(case: str, tmp_path: Path) -> None:
    lines = [own(BASE + at, t=stamp) for at, stamp in AT_ODD_RATES[case]]
    found = judge(spec(tmp_path, "{field: t, unit: ns, epoch: boot}"), log(tmp_path, *lines))
    assert "span" not in found.said


def test_a_stamp_in_another_unit_is_said_once(tmp_path: Path) -> None:
    found = judge(spec(tmp_path), log(tmp_path, *(own(BASE + at, (BASE + at) // 1000) for at in TICKS)))
    assert found.strict == 3
    (note,) = found.summary["notes"]
    assert "which are microseconds: it is taken for nanoseconds (60 such lines)" in note


def test_stamps_since_boot_that_the_spec_does_not_name_are_said_too(tmp_path: Path) -> None:
    found = judge(spec(tmp_path), log(tmp_path, *(own(BASE + at, (100 * S + at) // 1000) for at in TICKS)))
    assert found.strict == 3
    assert found.said == "/a: its stamps span 0.0059 s, and its arrivals 5.9 s: they are in another unit"


def test_long_recordings_are_sampled(tmp_path: Path) -> None:
    lines = [own(BASE + at * 10**7, t=at * 10**4 + 1) for at in range(1000)]
    found = judge(spec(tmp_path, "{field: t, unit: ns, epoch: boot}"), log(tmp_path, *lines))
    assert found.strict == 3
    assert "`t` looks like microseconds, and is taken for nanoseconds" in found.said


def test_stamps_of_a_bag_in_another_unit_are_said(tmp_path: Path) -> None:
    text = SPEC.replace("msg.v", "msg.data").replace("v < 5", "v > 5")
    bag = write_numbers(
        tmp_path / "bag", {"/a": [(at, 5e6 + at * 1e3) for at in range(0, 3000, 50)]}, StoragePlugin.MCAP
    )
    found = judge(spec(tmp_path, "{field: data, unit: ns, epoch: boot}", text), bag)
    assert found.strict == 3
    assert "/a: its stamps span 0.00295 s, and its arrivals 2.95 s: `data` looks like microseconds" in found.said


def test_formulas_over_seconds_need_times(tmp_path: Path) -> None:
    text = SPEC.replace("id: low", "id: low, time: seconds")
    found = judge(spec(tmp_path, text=text), log(tmp_path, own(), own()))
    assert (found.exit, found.strict) == (0, 3)
    assert "no time passes where none is said: 2 lines of 2" in found.said


def test_a_bag_says_which_stamps_can_not_be_read(tmp_path: Path) -> None:
    text = SPEC.replace("msg.v", "msg.data")
    bag = write_numbers(tmp_path / "bag", {"/a": [(1, 1.0), (2, -1.0), (3, -2.0)]}, StoragePlugin.MCAP)
    found = judge(spec(tmp_path, "data", text), bag)
    assert (found.exit, found.strict) == (0, 3)
    assert "/a: 2 of its 3 messages are ordered by arrival: `data` is -1.0, and no time" in found.said


BROKEN: dict[str, tuple[str, str]] = {
    "a comma is missing": ('{"stream": "/a" "data": {}}', 'not JSON, from column 17 on: "data": {}}'),
    "single quotes": ("{'stream': '/a'}", "not JSON, from column 2 on: 'stream': '/a'}"),
    "cut": ('{"stream": "/a", "data": {', "not JSON: it ends early, at column 26; an event is one line"),
    "two objects": ('{"stream": "/a", "data": {}} {}', "at column 30 something follows its JSON object: {}; write"),
    "a fraction": (
        '{"stream": "/a", "stamp": 12.5, "data": {}}',
        "`stamp` is 12.5; write a time in whole nanoseconds since 1970, as 12500000000 for 12.5 s",
    ),
    "negative": ('{"stream": "/a", "arrived": -1, "data": {}}', "`arrived` is -1; write a time in whole nanoseconds"),
    "a text": ('{"stream": "/a", "arrived": "1", "data": {}}', "`arrived` is '1'; write a time in whole nanoseconds"),
    "an odd kind": ('{"stream": "/a", "kind": "x", "data": {}}', "`kind` is 'x'; write `topic`, `request`, `response`"),
    "a list": ('{"stream": "/a", "data": [1]}', "`data` is a list of 1; write the message's fields, as an object"),
    "a number": ('{"stream": 5, "data": {}}', "`stream` is 5; write the name of a topic or service"),
    "no object": ("[1]", "it is no JSON object; write one a line, as {…}"),
    "no message": ('{"stream": "/a"}', "the field `data` is missing"),
    "odd places": ('{"stream": "/a", "data": {}, "places": 5}', "`places` is 5, which it can't be"),
    "odd things in it": ('{"stream": "/a", "data": {}, "failed": [5]}', "`failed` is a list of 1, which it can't be"),
    "half a pair": ('{"stream": "/a", "data": {"x": "\\ud800"}}', "it has half a surrogate pair, which is no text"),
    "zeros": (
        "\0" * 4096,
        "from column 1 on it has NUL bytes, as where the power failed; delete them, or cut it there",
    ),
    "many digits": (
        f'{{"stream": "/a", "data": {{"x": {"9" * 5000}}}}}',
        "it has a whole number with more than 4,300 digits",
    ),
    "many exponents": (
        f'{{"stream": "/a", "data": {{"x": [{", ".join(["1e-310"] * 4001)}]}}}}',
        "it has more than 4000 numbers with exponents of three digits",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_line_that_is_no_event_is_told_in_plain_words(case: str, tmp_path: Path) -> None:
    text, said = BROKEN[case]
    path = log(tmp_path, own(1), own(2), text, own(3))
    with pytest.raises(TraceError) as error:
        judge(spec(tmp_path), path)
    assert str(error.value).startswith(f"{path}:3: not an event: {said}")


def test_a_last_line_that_was_cut_anywhere_is_left_out_and_told(tmp_path: Path) -> None:
    last = json.dumps(own(3, text="} a {b}", inner={"x": {"y": 1}}))
    for length in range(1, len(last)):
        path = log(tmp_path, own(1), own(2))
        path.write_text(path.read_text() + last[:length])
        found = judge(spec(tmp_path), path)
        assert found.summary["events"] == 2, last[:length]
        assert f"{path.name}:3: ends early, within a line" in found.said, last[:length]
        assert (found.exit, found.strict) == (0, 3), last[:length]


def test_a_last_line_that_is_whole_counts_without_its_end(tmp_path: Path) -> None:
    path = log(tmp_path, own(1), own(2))
    path.write_text(path.read_text().rstrip())
    found = judge(spec(tmp_path), path)
    assert (found.summary["events"], found.strict) == (2, 0)


def test_a_line_that_is_no_text_is_told_in_plain_words(tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    path.write_bytes(b'{"stream": "/a", "data": {}}\n{"stream": "\xff"}\n')
    with pytest.raises(TraceError) as error:
        judge(spec(tmp_path), path)
    assert str(error.value) == f"{path}:2: not an event: it is not UTF-8 text"


NUMBERS = """
id: numbers
streams: [{topic: /a, signals: {v: msg.data}}]
properties: [{id: low, formula: '{v: *} -> {v < 5}'}]
"""


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("topic", ["/a", "/of_nobody"])
@pytest.mark.parametrize("odd", [5_000_000, 4_102_444_800 * S], ids=["1970", "2100"])
def test_a_year_in_which_nothing_arrives_is_said(odd: int, topic: str, storage: StoragePlugin, tmp_path: Path) -> None:
    """A deadline that runs out in it is a violation, though nobody waited so long."""
    topics = {"/a": [(0, 1.0), (500, 1.0)]}
    topics.setdefault(topic, []).append(((odd - BASE) // 10**6, 1.0))
    bag = write_numbers(tmp_path / "bag", topics, storage)
    found = judge(write_spec(tmp_path, NUMBERS), bag)
    assert (found.exit, found.strict) == (0, 3)
    (note,) = found.summary["notes"]
    between = {
        5_000_000: "for 54.9 years, from 0.005 s to 2024-11-21",
        4_102_444_800 * S: "to 2100-01-01 00:00:00.000Z",
    }[odd]
    assert "nothing arrived for" in note
    assert between in note
    assert note.endswith(": a clock was set, or a time is wrong; deadlines between these times ran out")


def test_a_bag_in_the_time_of_a_simulation_has_no_leap(tmp_path: Path) -> None:
    bag = write_numbers(tmp_path / "bag", {"/a": [(-BASE // 10**6 + at, 1.0) for at in range(5)]}, StoragePlugin.MCAP)
    found = judge(write_spec(tmp_path, NUMBERS), bag)
    assert (found.exit, found.strict, found.said) == (0, 0, "")


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("unit", ["seconds", "milliseconds", "microseconds"])
def test_times_of_a_bag_in_another_unit_are_said(unit: str, storage: StoragePlugin, tmp_path: Path) -> None:
    """As a program of its own may write them: no deadline runs out in them."""
    size = {"seconds": S, "milliseconds": 10**6, "microseconds": 1000}[unit]
    path, name, store = tmp_path / "bag", "std_msgs/msg/Float64", get_typestore(Stores.ROS2_HUMBLE)
    with Writer(path, version=9, storage_plugin=storage) as writer:
        connection = writer.add_connection("/a", name, typestore=store)
        for at in range(20):
            writer.write(connection, (BASE + at * S) // size, store.serialize_cdr(store.types[name](data=1.0), name))
    found = judge(write_spec(tmp_path, NUMBERS), path)
    assert (found.exit, found.strict) == (0, 3)
    assert f"its times look like {unit}, and are taken for nanoseconds: all lie within" in found.said
