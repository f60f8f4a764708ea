"""What `check` says of a spec by the types of its messages."""

from __future__ import annotations

from pathlib import Path

import pytest

from oracle_server.core.errors import SpecError
from oracle_server.core.hazards.ros import Ros
from oracle_server.core.plan import plan
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.library import Library
from oracle_server.specfiles.load import SpecFile, parse_spec
from tests.rostypes.making import package

STANDARD = Types(environment={})


def spec(streams: str, formula: str = "{d}") -> str:
    return f"id: x\nstreams:\n{streams}\nproperties:\n  - id: p\n    formula: '{formula}'\n"


def read(text: str, types: Types = STANDARD, ros: Ros | None = None) -> SpecFile:
    return parse_spec(text, "x.yaml", ros, types=types)


def warnings(text: str, types: Types = STANDARD, ros: Ros | None = None) -> list[str]:
    return [str(w).removeprefix("x.yaml:") for w in read(text, types, ros).warnings]


ONLY_ROS_1 = spec("  - topic: /a\n    type: std_msgs/Header\n    signals: {d: msg.seq}", "{d: 7}")


def test_a_field_of_ros_1_alone_is_warned_of_unless_the_version_is_told() -> None:
    (warning,) = warnings(ONLY_ROS_1)
    assert "another version of ROS has it" in warning
    assert warnings(ONLY_ROS_1, ros=1) == []
    with pytest.raises(SpecError, match="has no field `seq`"):
        read(ONLY_ROS_1, ros=2)


BYTES = spec(
    "  - topic: /a\n    type: std_msgs/ByteMultiArray\n    signals: {d: 'msg.data[0] < 0 && msg.data.all(b, b > -9)'}"
)


def test_bytes_that_are_a_list_on_ros_1_alone_are_read_as_one_unless_the_version_is_told() -> None:
    told = warnings(BYTES)
    assert len(told) == 2
    assert all("`msg.data` is a list of signed numbers on ROS 1, and a text in base64 on ROS 2" in one for one in told)
    assert not [one for one in warnings(BYTES, ros=1) if "base64" in one]
    with pytest.raises(SpecError, match="is bytes, which arrive as a text in base64, and no list"):
        read(BYTES, ros=2)


def test_an_unknown_package_is_told_of_once_and_made_known_by_its_folder(tmp_path: Path) -> None:
    text = spec(
        "  - {topic: /a, type: arm_msgs/msg/State, signals: {d: msg.x}}\n"
        "  - {topic: /b, type: arm_msgs/msg/Joint, signals: {e: msg.x}}",
        "not {d}",
    )
    (warning,) = warnings(text)
    assert warning.startswith("3:23: warning: the package arm_msgs is not known here")
    assert "--types" in warning
    package(tmp_path / "arm_msgs", {"msg/State.msg": "float64 y\n", "msg/Joint.msg": "float64 x\n"})
    with pytest.raises(SpecError, match="arm_msgs/msg/State has no field `x`"):
        read(text, Types([tmp_path], {}))


@pytest.mark.parametrize(
    ("streams", "told"),
    [
        (
            "  - topic: /a",
            "'d' is declared by no stream; it would be read from a field of /a, whose `type` is not given",
        ),
        (
            "  - service: /a\n    request: {signals: {e: msg.e}}",
            "'d' is declared by no stream; it would be read from a field of /a responses, whose `type` is not given",
        ),
    ],
)
def test_a_signal_that_only_an_unknown_message_could_have_is_warned_of(streams: str, told: str) -> None:
    text = spec(streams, "not {d}")
    line = text.count("\n", 0, text.index("{d}")) + 1
    assert warnings(text) == [f"{line}:19: warning: formula of 'p': {told}"]


def test_a_signal_that_another_stream_declares_is_not_said_to_be_of_none() -> None:
    streams = "  - topic: /a\n  - {topic: /b, signals: {d: msg.x}}"
    told = (
        "'d' is a signal of /b, and not declared here: it would be read from a field of /a, whose `type` is not given"
    )
    assert warnings(spec(streams, "not {topic: /a, d}")) == [f"7:19: warning: formula of 'p': {told}"]
    assert warnings(spec(streams, "not {topic: /b, d}")) == []


def test_the_key_of_a_stream_is_told_where_an_unknown_message_could_have_what_stands_for_it() -> None:
    streams = "  - topic: /a\n  - {topic: /b, signals: {e: msg.x}}\n  - {service: /s, request: {signals: {}}}"
    for name, told in (("/b", 'topic: "/b"'), ("/s", 'service: "/s"')):
        (warning,) = warnings(spec(streams, f"not {{action: {name}}}"))
        assert warning.endswith(f"it would be read from a field of /a or /s responses, whose `type` is not given; "
                                f"for the stream write `{told}`")  # fmt: skip


def test_a_signal_of_one_half_is_no_error_where_the_other_has_it() -> None:
    half = "  - service: /a\n    type: std_srvs/srv/SetBool\n    request: {signals: {e: msg.data}}"
    assert warnings(spec(half, "not {success}")) == []
    with pytest.raises(SpecError, match=r"unknown signal 'sucess'.*did you mean `success`"):
        read(spec(half, "{sucess}"))


def test_signals_of_two_streams_are_not_met_at_once() -> None:
    streams = "  - {topic: /a, type: std_msgs/msg/Float64}\n  - {topic: /b, type: turtlesim/msg/Pose}"
    assert warnings(spec(streams, "{data > 1} or {theta > 1}")) == []
    with pytest.raises(SpecError, match="no event of this spec has all the signals"):
        read(spec(streams, "{data > 1, theta > 1}"))


def test_a_scan_without_a_return_is_judged_by_the_natural_expressions() -> None:
    near = "near: 'msg.ranges.exists(r, r < 0.5)', least: min(msg.ranges) < 0.5"
    signals = f"{{{near}, capped: 'min(min(msg.ranges), msg.range_max)'}}"
    stream = f"  - topic: /scan\n    type: sensor_msgs/msg/LaserScan\n    signals: {signals}"
    loaded = read(spec(stream, "not ({near} or {least} or {capped < 0.5})"))
    assert loaded.warnings == ()
    (scan,) = plan(loaded.spec).streams.values()
    clear = {"ranges": ["Infinity", 2.5, "Infinity"], "range_max": 10.0}
    assert scan.project(clear) == ({"near": False, "least": False, "capped": 2.5}, frozenset())
    assert scan.project({**clear, "ranges": ["Infinity"] * 3})[0]["capped"] == 10.0
    assert scan.project({**clear, "ranges": ["NaN", 2.5]}) == ({}, frozenset({"near", "least", "capped"}))
    assert scan.project({**clear, "ranges": ["NaN", 0.1]})[0] == {"near": True}


@pytest.mark.parametrize(
    ("formula", "told"),
    [
        ("{topic: /b, data}", "`data` of /b is always a number; write a comparison, as in `data > 0`"),
        ("{topic: /b, data: false}", "`data` of /b is always a number; write a comparison, as in `data: 0`"),
        ("{data: True}", "`data` of /a and /b is always true or false or a number; write `data: true`"),
        ("{topic: /a, data > 1}", "texts and Booleans are neither smaller nor larger than a number"),
    ],
)
def test_a_field_is_judged_by_the_streams_that_can_meet_the_atom(formula: str, told: str) -> None:
    streams = "  - {topic: /a, type: std_msgs/msg/Bool}\n  - {topic: /b, type: std_msgs/msg/Float64}"
    (warning,) = warnings(spec(streams, formula))
    assert warning.endswith(told)
    assert warnings(spec(streams, "{data} or {data > 1}")) == []


def test_a_field_that_changed_its_type_is_taken_for_either(tmp_path: Path) -> None:
    package(tmp_path / "share" / "std_msgs", {"msg/Bool.msg": "string data\n", "package.xml": "<package/>"})
    types = Types(environment={"AMENT_PREFIX_PATH": str(tmp_path)})
    stream = "  - {topic: /a, type: std_msgs/msg/Bool}"
    assert warnings(spec(stream, "{data} or {data: AUTO}"), types) == []
    assert len(warnings(spec(stream, "{data} or {data: AUTO}"))) == 1


def test_stored_specs_are_not_held_to_types() -> None:
    assert parse_spec(spec("  - {topic: /a, type: std_msgs/msg/Nothing, signals: {d: msg.d}}"), "x").warnings == ()


def test_a_put_is_checked_as_check_does(tmp_path: Path) -> None:
    library = Library(None, tmp_path, STANDARD)
    with pytest.raises(SpecError, match="no msg 'Floot64'"):
        library.put("x", spec("  - {topic: /a, type: std_msgs/msg/Floot64, signals: {d: msg.data}}"))
    assert library.listed() == []
    entry, _ = library.put("x", spec("  - {topic: /a, type: arm_msgs/msg/A, signals: {d: msg.data}}"))
    assert "arm_msgs" in str(entry.file.warnings[0])


def test_a_whole_number_as_stamp_without_a_unit_is_warned_of(tmp_path: Path) -> None:
    package(tmp_path / "px4_msgs", {"msg/Status.msg": "uint64 timestamp # us\nfloat64 t\nbool d\n"})
    types, text = Types([tmp_path], {}), "  - {topic: /a, type: px4_msgs/msg/Status, stamp: %s}"
    (warning,) = warnings(spec(text % "timestamp"), types)
    assert "uint64 `timestamp` is read as seconds; say its unit" in warning
    for sound in ("t", "{field: timestamp, unit: us}", "{field: timestamp, unit: s, epoch: boot}"):
        assert warnings(spec(text % sound), types) == []


def test_a_stamps_unit_is_part_of_what_a_spec_means() -> None:
    def digest(stamp: str) -> str:
        return read(spec(f"  - {{topic: /a, stamp: {stamp}}}")).spec.digest

    assert digest("t") == digest("{field: t}")
    assert len({digest(s) for s in ("t", "{field: t, unit: us}", "{field: t, unit: us, epoch: boot}")}) == 3


def test_an_upload_that_was_accepted_when_its_types_were_unknown_is_kept(tmp_path: Path) -> None:
    text = spec("  - {topic: /a, type: arm_msgs/msg/A, signals: {d: msg.data}}")
    Library(None, tmp_path / "put", STANDARD).put("x", text)
    package(tmp_path / "arm_msgs", {"msg/A.msg": "float64 x\n"})
    again = Library(None, tmp_path / "put", Types([tmp_path / "arm_msgs"], {}))
    assert "has no field `data`" in str(again.get("x").file.warnings[0])
    with pytest.raises(SpecError):
        again.put("x", text)
