"""Types by name: of folders, of what is sourced, of the standard packages; and why one is not known."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest

from oracle_server.core.expression import check_shape, parse_expression
from oracle_server.core.hazards.readings import at
from oracle_server.core.shapes import Many, Record, Shape, Value
from oracle_server.core.typed import Missing, TypedMessage
from oracle_server.replay.doubts.misfit import misfit
from oracle_server.rostypes.folders import TypesError
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.load import parse_spec
from tests.rostypes.making import package

STANDARD = Types(environment={})


def shape(name: str, types: Types = STANDARD, ros: int | None = None) -> Record:
    """The shape of a type that is known."""
    found = types.message(name, ros)  # type: ignore[arg-type]
    assert isinstance(found, TypedMessage), found
    return found.shape


def missing(name: str, types: Types = STANDARD) -> Missing:
    """Why a type is not known."""
    found = types.message(name)
    assert isinstance(found, Missing)
    return found


@pytest.mark.parametrize(
    ("name", "path", "expected"),
    [
        ("geometry_msgs/msg/Twist", "linear.x", Value("real", "float64")),
        ("std_msgs/msg/String", "data", Value("text", "string")),
        ("std_msgs/msg/Bool", "data", Value("bool", "bool")),
        ("sensor_msgs/msg/Image", "data", Value("bytes", "uint8[]")),
        ("sensor_msgs/msg/LaserScan", "ranges", Many(Value("real", "float32"))),
        ("geometry_msgs/msg/PoseWithCovariance", "covariance", Many(Value("real", "float64"), 36)),
        ("nav_msgs/msg/Odometry", "header.stamp.nanosec", Value("whole", "uint32")),
        ("std_srvs/srv/SetBool_Request", "data", Value("bool", "bool")),
        ("std_srvs/srv/SetBool_Response", "message", Value("text", "string")),
        ("turtlesim/srv/Spawn_Request", "theta", Value("real", "float32")),
    ],
)
def test_standard_types_have_their_fields(name: str, path: str, expected: Shape) -> None:
    assert at(shape(name), tuple(path.split("."))) == expected


def test_what_only_another_version_of_ros_has_is_told_apart() -> None:
    found = STANDARD.message("std_msgs/msg/Header")
    assert isinstance(found, TypedMessage)
    assert "seq" not in found.shape.fields
    assert found.anywhere is not None
    assert "seq" in found.anywhere.fields
    assert "seq" in shape("std_msgs/msg/Header", ros=1).fields
    only_two = STANDARD.message("std_msgs/msg/Header", 2)
    assert isinstance(only_two, TypedMessage)
    assert "seq" not in only_two.widest.fields
    assert set(shape("builtin_interfaces/msg/Time", ros=1).fields) == {"sec", "nanosec", "secs", "nsecs"}
    assert set(shape("builtin_interfaces/msg/Time").fields) == {"sec", "nanosec"}


@pytest.mark.parametrize(
    ("name", "severity", "words"),
    [
        ("sensor_msgs/msg/LasrScan", "error", "did you mean `LaserScan`?"),
        ("std_msgs/msg/SetBool", "error", "no msg 'SetBool'"),
        ("std_srvs/msg/SetBool", "error", "std_srvs/srv/SetBool is a service"),
        ("sensor_msgs/srv/LaserScan_Request", "error", "sensor_msgs/msg/LaserScan is a message"),
        ("sensor_msg/msg/LaserScan", "warning", "did you mean `sensor_msgs`?"),
        ("nav2_msgs/msg/Costmap", "warning", "--types"),
        ("my_robot/msg/Arm", "warning", "the package my_robot is not known here"),
    ],
)
def test_a_type_that_is_not_known_is_told_of(name: str, severity: str, words: str) -> None:
    found = missing(name)
    assert found.severity == severity
    assert words in found.message


@pytest.mark.parametrize(
    "package", ["nav2_msgs", "grid_map_msgs", "px4_msgs", "rmf_task_msgs", "autoware_control_msgs"]
)
def test_a_package_that_is_well_known_is_no_misspelt_other_one(package: str) -> None:
    told = missing(f"{package}/msg/Some").message
    assert "did you mean" not in told
    assert f"the package {package} is not known here" in told


def test_a_folder_defines_messages_services_and_actions(tmp_path: Path) -> None:
    package(
        tmp_path / "arm_msgs",
        {
            "msg/State.msg": "# arm\nuint8 IDLE=0\nstring ID=a # b\nHeader header\nJoint[] joints\nstring<=5 name 'a'",
            "msg/Joint.msg": "float32[<=3] angles\ntime since\nbyte[4] raw\n",
            "srv/Move.srv": "float64 to 1.5 # metres\n---\nbool ok\n",
            "action/Grip.action": "float64 force\n---\nbool held\n---\nfloat64 gap\n",
        },
    )
    types = Types([tmp_path], {})
    state = shape("arm_msgs/msg/State", types)
    assert set(state.fields) == {"header", "joints", "name"}
    joints = state.fields["joints"]
    assert isinstance(joints, Many)
    assert isinstance(joints.of, Record)
    assert joints.of.fields["angles"] == Many(Value("real", "float32"))
    assert joints.of.fields["raw"] == Value("bytes", "byte[4]", may_be_list=True)
    assert at(joints.of, ("since", "sec")) == Value("whole", "int32")
    assert shape("arm_msgs/srv/Move_Request", types).fields == {"to": Value("real", "float64")}
    assert at(shape("arm_msgs/msg/GripActionFeedback", types), ("feedback", "gap")) == Value("real", "float64")
    assert "did you mean `State`?" in missing("arm_msgs/msg/Stat", types).message


def package_xml(name: str) -> str:
    return f"<?xml version='1.0'?>\n<package format='3'>\n  <name>{name}</name>\n  <description/>\n</package>\n"


@pytest.mark.parametrize("given", [".", "arm_msgs-main", "arm_msgs-main/msg"])
def test_a_package_is_called_as_it_says_whatever_its_folder_is_called(given: str, tmp_path: Path) -> None:
    files = {"package.xml": package_xml("arm_msgs"), "msg/State.msg": "Joint joint\n", "msg/Joint.msg": "float64 q\n"}
    package(tmp_path / "arm_msgs-main", files)
    types = Types([tmp_path / given], {})
    assert at(shape("arm_msgs/msg/State", types), ("joint", "q")) == Value("real", "float64")
    assert missing("arm_msgs/msg/Stat", types).severity == "error"


@pytest.mark.parametrize("given", [".", "arm_msgs", "arm_msgs/modes"])
def test_a_package_has_definitions_in_folders_of_its_own(given: str, tmp_path: Path) -> None:
    files = {
        "package.xml": package_xml("arm_msgs"), "modes/msg/Mode.msg": "uint8 mode\n",
        "modes/srv/Set.srv": "Mode to\n---\n"
    }  # fmt: skip
    package(tmp_path / "arm_msgs", files)
    types = Types([tmp_path / given], {})
    assert at(shape("arm_msgs/srv/Set_Request", types), ("to", "mode")) == Value("whole", "uint8")


def test_types_that_are_gathered_within_a_package_are_of_those_that_they_are_called_by(tmp_path: Path) -> None:
    files = {
        "package.xml": package_xml("robot"), "a_types/arm_msgs/msg/State.msg": "float64 q\n",
        "msg/State.msg": "bool on\n"
    }  # fmt: skip
    package(tmp_path / "robot", files)
    types = Types([tmp_path], {})
    assert set(shape("arm_msgs/msg/State", types).fields) == {"q"}
    assert set(shape("robot/msg/State", types).fields) == {"on"}


def test_a_definition_of_which_the_package_is_not_sure_is_refused_once(tmp_path: Path) -> None:
    package(tmp_path / "arm_msgs", {"package.xml": package_xml("arm_msgs"), "modes/msg/Bad.msg": "float x\n"})
    with pytest.raises(TypesError) as refused:
        Types([tmp_path], {})
    assert "\n" not in str(refused.value)


def test_a_folders_definition_is_what_the_robot_has(tmp_path: Path) -> None:
    package(tmp_path / "std_msgs", {"msg/Header.msg": "time stamp\n"})
    found = Types([tmp_path], {}).message("std_msgs/msg/Header")
    assert isinstance(found, TypedMessage)
    assert found.anywhere is None
    assert set(found.shape.fields) == {"stamp"}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("float64 x\nfloat y\n", ":2: `float` is no type"),
        ("float64\n", ":1: `float64` is no field"),
        ("float64 x\nint8 x\n", ":2: the field `x` stands here a second time"),
        ("float64 x\n---\nint8 y\n", ":2: a .msg file has no lines `---`"),
        ("\udcff", "not UTF-8"),
    ],
)
def test_a_malformed_definition_is_refused_with_its_line(tmp_path: Path, text: str, told: str) -> None:
    path = package(tmp_path / "bad_msgs", {"msg/Bad.msg": text, "msg/Good.msg": "int8 x\n"}) / "msg" / "Bad.msg"
    with pytest.raises(TypesError) as refused:
        Types([tmp_path], {})
    assert str(refused.value).startswith(str(path))
    assert told in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name", ["missing", "empty"])
def test_a_folder_without_definitions_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(TypesError, match="name the folder of a package"):
        Types([tmp_path / name], {})


@pytest.mark.parametrize("variable", ["AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "ROS_PACKAGE_PATH"])
def test_what_is_sourced_is_known(tmp_path: Path, variable: str) -> None:
    share = tmp_path if variable == "ROS_PACKAGE_PATH" else tmp_path / "share"
    package(share / "arm_msgs", {"msg/State.msg": "float64 x\n", "msg/Bad.msg": "float x\n", "msg/Odd.idl": "module"})
    environment: Mapping[str, str] = {variable: f"/nowhere:{tmp_path}"}
    types = Types(environment=environment)
    assert set(shape("arm_msgs/msg/State", types).fields) == {"x"}
    assert missing("arm_msgs/msg/Stat", types).severity == "error"
    for name in ("Bad", "Odd"):
        found = missing(f"arm_msgs/msg/{name}", types)
        assert found.severity == "warning"
        assert "can't be read" in found.message


def test_of_a_message_with_a_field_of_an_unknown_type_the_others_are_checked(tmp_path: Path) -> None:
    state = "string group\nother_msgs/Thing thing\nother_msgs/Thing[] things\nother_msgs/Time at\n"
    package(tmp_path / "arm_msgs", {"msg/State.msg": state, "msg/A.msg": "B b\nB c\n", "msg/B.msg": "A a\nA d\n"})
    types = Types([tmp_path], {})
    found = types.message("arm_msgs/msg/State")
    assert isinstance(found, TypedMessage)
    assert found.unknown == ("other_msgs/msg/Thing", "other_msgs/msg/Time")
    looping = types.message("arm_msgs/msg/A")
    assert isinstance(looping, TypedMessage)
    assert looping.unknown == ("arm_msgs/msg/A",)
    for right in ("msg.thing.x.y == 1", "msg.things.exists(t, t.name == 'a')", "msg.things[0].x", "msg.group == 'arm'"):
        assert not check_shape(parse_expression(right), found.shape), right
    data: tuple[dict[str, object], ...] = ({"thing": 1}, {"things": [{"a": 1}]}, {"thing": {"b": []}})
    assert not any(misfit(found.shape, each) for each in data)
    for wrong in ("msg.group_name == 'arm'", "msg.group == 1", "msg.things == 1"):
        assert check_shape(parse_expression(wrong), found.shape), wrong


def test_what_is_not_known_within_messages_is_said_once(tmp_path: Path) -> None:
    package(tmp_path / "arm_msgs", {"msg/State.msg": "string group\nother_msgs/Thing thing\n"})
    spec = """
id: s
streams:
  - {topic: /a, type: arm_msgs/msg/State, stamp: thing.time, signals: {g: msg.group}}
  - {topic: /b, type: arm_msgs/msg/State, signals: {h: msg.thing.h}}
properties: [{id: p, formula: '{g: arm} or {h: 1}'}]
"""
    (found,) = parse_spec(spec, "s", types=Types([tmp_path], {})).warnings
    assert "the type other_msgs/msg/Thing of a field is not known here, so what stands in it is not checked" in str(
        found
    )


def test_the_events_of_a_service_are_known_by_its_definition(tmp_path: Path) -> None:
    package(tmp_path / "arm_msgs", {"srv/Move.srv": "float64 speed\n---\nbool ok\n"})
    types = Types([tmp_path], {})
    events = shape("arm_msgs/srv/Move_Event", types)
    assert at(events, ("info", "stamp", "sec")) == Value("whole", "int32")
    for half, fields in {
        "request": {"speed": Value("real", "float64")},
        "response": {"ok": Value("bool", "bool")},
    }.items():
        found = events.fields[half]
        assert isinstance(found, Many)
        assert isinstance(found.of, Record)
        assert found.of.fields == fields
    assert "has no srv 'Mov'; did you mean `Move`?" in missing("arm_msgs/srv/Mov_Event", types).message
    assert missing("legs_msgs/srv/Move_Event", types).severity == "warning"


def test_services_of_ros_1_have_no_events() -> None:
    found = STANDARD.message("std_srvs/srv/SetBool_Event", 1)
    assert isinstance(found, Missing)
    assert found.severity == "error"
    assert "services tell nothing of their calls; observe the service itself" in found.message
