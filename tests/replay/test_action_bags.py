"""The topics beneath an action in a bag are the action's events: hidden ones and service events, or ROS 1's five."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from oracle_server.core.events import Event
from oracle_server.replay.bags.bag import Bag
from oracle_server.specfiles.load import parse_spec
from tests.replay.judging import BASE, MS, judge, write_spec

ACTION = "float64 x\nPoint at\n---\nint32 code\n---\nfloat64 left\n"
DEPENDENCY = "=" * 80 + "\nMSG: moves/Point\nfloat64 y\n"
KINDS = ("goal", "reply", "feedback", "cancel", "result", "status")
SPEC = """
id: moving
ordering: {{by: arrival}}
streams:
  - ros_action: /move
    type: moves/action/Move
    {more}
    goal: {{signals: {{x: msg.x, y: msg.at.y}}}}
    reply: {{signals: {{taken: msg.accepted}}}}
    feedback: {{signals: {{left: msg.left}}}}
    cancel: {{}}
    result: {{signals: {{code: msg.code}}}}
    status: {{}}
properties:
  - id: small
    formula: '{{ros_action: /move, kind: goal}} -> {{x <= 5}}'
    {guards}
  - id: results_have_goals
    formula: 'forall[g]. {{kind: result, goal_id: *g}} -> once {{kind: goal, goal_id: *g}}'
"""
PLAIN = SPEC.format(more="action: log", guards="")
FILTERED = SPEC.format(more="action: filter", guards="guards: [/move]\n    blame: any")
ONE, TWO = "01" * 16, "02" * 16
Row = tuple[str, int, Any]
"""What the message of a topic is made of, and its time in ms."""


def two() -> Typestore:
    """The types that a ROS 2 has of the action, each as a message."""
    store = get_typestore(Stores.LATEST)
    texts = {
        "Point": "float64 y\n", "Goal": "float64 x\nmoves/Point at\n", "Result": "int32 code\n",
        "Feedback": "float64 left\n",
        "FeedbackMessage": "unique_identifier_msgs/UUID goal_id\nmoves/Feedback feedback\n",
        "SendRequest": "unique_identifier_msgs/UUID goal_id\nmoves/Goal goal\n",
        "SendResponse": "bool accepted\nbuiltin_interfaces/Time stamp\n",
        "GetRequest": "unique_identifier_msgs/UUID goal_id\n",
        "GetResponse": "int8 status\nmoves/Result result\n",
        "CancelRequest": "action_msgs/GoalInfo goal_info\n",
        "CancelResponse": "int8 return_code\naction_msgs/GoalInfo[] goals_canceling\n",
        "Info": "uint8 event_type\nbuiltin_interfaces/Time stamp\nuint8[16] client_gid\nint64 sequence_number\n",
        **{
            f"{call}Event": f"moves/Info info\nmoves/{call}Request[<=1] request\nmoves/{call}Response[<=1] response\n"
            for call in ("Send", "Get", "Cancel")
        },
    }  # fmt: skip
    found: dict[str, Any] = {}
    for name, text in texts.items():
        found |= get_types_from_msg(text, f"moves/msg/{name}")
    store.register(found)
    return store


class Robot2:
    """Writes what a recorder hears of an action on ROS 2."""

    def __init__(self, path: Path, storage: StoragePlugin, definition: str = ACTION + DEPENDENCY) -> None:
        self.path, self.storage, self._definition = path, storage, definition
        self._store = two()
        self._rows: list[tuple[str, str, int, bytes]] = []

    def _make(self, name: str, **fields: Any) -> Any:
        return self._store.types[name if "/" in name else f"moves/msg/{name}"](**fields)

    def _time(self, at: int) -> Any:
        return self._make("builtin_interfaces/msg/Time", sec=(BASE + at * MS) // 10**9, nanosec=at * MS)

    def _id(self, goal: str) -> Any:
        return self._make("unique_identifier_msgs/msg/UUID", uuid=np.frombuffer(bytes.fromhex(goal), dtype=np.uint8))

    def _add(self, topic: str, type_: str, at: int, name: str, message: Any) -> None:
        full = name if "/" in name else f"moves/msg/{name}"
        self._rows.append((topic, type_, at, bytes(self._store.serialize_cdr(message, full))))

    def _event(self, call: str, at: int, kind: int, number: int, **halves: Any) -> Any:
        gid = np.ones(16, dtype=np.uint8)
        info = self._make("Info", event_type=kind, stamp=self._time(at), client_gid=gid, sequence_number=number)
        return self._make(f"{call}Event", info=info, **{"request": [], "response": []} | halves)

    def send(self, at: int, goal: str, x: float, *, accepted: bool | None = True, side: str = "/move") -> None:
        topic, type_ = f"{side}/_action/send_goal/_service_event", "moves/action/Move_SendGoal_Event"
        point = self._make("Point", y=1.5)
        request = self._make("SendRequest", goal_id=self._id(goal), goal=self._make("Goal", x=x, at=point))
        self._add(topic, type_, at, "SendEvent", self._event("Send", at, 1, at, request=[request]))
        if accepted is not None:
            response = self._make("SendResponse", accepted=accepted, stamp=self._time(at))
            self._add(topic, type_, at + 1, "SendEvent", self._event("Send", at + 1, 2, at, response=[response]))

    def result(self, at: int, goal: str, status: int, code: int, side: str = "/move") -> None:
        topic, type_ = f"{side}/_action/get_result/_service_event", "moves/action/Move_GetResult_Event"
        request = self._make("GetRequest", goal_id=self._id(goal))
        response = self._make("GetResponse", status=status, result=self._make("Result", code=code))
        self._add(topic, type_, at, "GetEvent", self._event("Get", at, 1, at, request=[request]))
        self._add(topic, type_, at + 1, "GetEvent", self._event("Get", at + 1, 2, at, response=[response]))

    def cancel(self, at: int, goal: str, side: str = "/move") -> None:
        topic, type_ = f"{side}/_action/cancel_goal/_service_event", "action_msgs/srv/CancelGoal_Event"
        info = self._make("action_msgs/msg/GoalInfo", goal_id=self._id(goal), stamp=self._time(0))
        request = self._make("CancelRequest", goal_info=info)
        response = self._make("CancelResponse", return_code=0, goals_canceling=[])
        self._add(topic, type_, at, "CancelEvent", self._event("Cancel", at, 1, at, request=[request]))
        self._add(topic, type_, at + 1, "CancelEvent", self._event("Cancel", at + 1, 2, at, response=[response]))

    def feedback(self, at: int, goal: str, left: float, side: str = "/move") -> None:
        message = self._make("FeedbackMessage", goal_id=self._id(goal), feedback=self._make("Feedback", left=left))
        self._add(f"{side}/_action/feedback", "moves/action/Move_FeedbackMessage", at, "FeedbackMessage", message)

    def status(self, at: int, side: str = "/move", **goals: int) -> None:
        ids = {"one": ONE, "two": TWO}
        entries = [
            self._make(
                "action_msgs/msg/GoalStatus", status=code,
                goal_info=self._make("action_msgs/msg/GoalInfo", goal_id=self._id(ids[goal]), stamp=self._time(0)),
            )
            for goal, code in goals.items()
        ]  # fmt: skip
        message = self._make("action_msgs/msg/GoalStatusArray", status_list=entries)
        full = "action_msgs/msg/GoalStatusArray"
        self._add(f"{side}/_action/status", full, at, full, message)

    def write(self, path: Path | None = None, start: int = 0, stop: int = 10_000) -> Path:
        """A bag of what was heard from a time on (ms) and before another one."""
        path = path or self.path
        with Writer2(path, version=9, storage_plugin=self.storage) as writer:
            ids: dict[str, Any] = {}
            for topic, type_, at, raw in sorted(self._rows, key=lambda row: row[2]):
                if not start <= at < stop:
                    continue
                if topic not in ids:
                    ids[topic] = writer.add_connection(topic, type_, msgdef=self._definition, rihs01="RIHS01_00")
                writer.write(ids[topic], BASE + at * MS, raw)
        return path


def flight(robot: Robot2) -> Path:
    """One goal that is driven to its end while a second one is refused, and all are cancelled once."""
    robot.send(10, ONE, 3.0)
    robot.status(12, one=1)
    robot.status(13, one=2)
    robot.feedback(20, ONE, 2.5)
    robot.send(30, TWO, 9.0, accepted=False)
    robot.cancel(40, "00" * 16)
    robot.status(41, one=3)
    robot.status(50, one=5)
    robot.result(51, ONE, 5, 7)
    return robot.write()


def events(bag: Path, text: str = PLAIN) -> Iterator[Event]:
    for recorded in Bag(bag, parse_spec(text, "s.yaml").spec):
        yield recorded.event


def seen(bag: Path, text: str = PLAIN) -> list[tuple[str, str | None, str | None]]:
    return [(event.stream.kind, event.goal_id, event.status) for event in events(bag, text)]


FLIGHT = [
    ("goal", ONE, None), ("reply", ONE, "accepted"), ("status", ONE, "accepted"), ("status", ONE, "executing"),
    ("feedback", ONE, None), ("goal", TWO, None), ("reply", TWO, "rejected"), ("cancel", "", None),
    ("status", ONE, "canceling"), ("status", ONE, "canceled"), ("result", ONE, "canceled"),
]  # fmt: skip


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_hidden_topics_and_service_events_are_events_of_the_action(storage: StoragePlugin, tmp_path: Path) -> None:
    bag = flight(Robot2(tmp_path / "bag", storage))
    assert seen(bag) == FLIGHT
    found = list(events(bag))
    assert [e.data for e in found if e.stream.kind in ("goal", "feedback", "result")] == [
        {"x": 3.0, "at": {"y": 1.5}}, {"left": 2.5}, {"x": 9.0, "at": {"y": 1.5}}, {"code": 7}
    ]  # fmt: skip
    calls = [e.call for e in found if e.stream.kind in ("goal", "reply", "cancel")]
    assert calls[:2] == [calls[0]] * 2, "a goal and its reply have one number"
    assert calls[2:4] == [calls[2]] * 2
    assert len(set(calls)) == 3
    assert [e.stamp for e in found if e.stream.kind == "goal"] == [BASE + 10 * MS, BASE + 30 * MS]
    judged = judge(write_spec(tmp_path, PLAIN), bag)
    assert judged.summary["events"] == len(FLIGHT)
    assert judged.summary["ignored"] == 0
    assert {name: state["violations"] for name, state in judged.summary["properties"].items()} == {
        "small": 1, "results_have_goals": 0
    }  # fmt: skip
    assert judged.summary["streams"]["/move goals"]["signals"]["y"]["present"] == 2


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("border", [11, 13, 31, 41, 50, 52])
def test_a_bag_of_several_files_has_the_events_of_one(border: int, storage: StoragePlugin, tmp_path: Path) -> None:
    """A file may end between a request and its response, and repeats nothing that was said in the one before."""
    robot = Robot2(tmp_path / "bag", storage)
    flight(robot)
    robot.status(52, one=5)
    bag = tmp_path / "split"
    bag.mkdir()
    for name, start, stop in (("s_0", 0, border), ("s_1", border, 10_000)):
        part = robot.write(tmp_path / name, start, stop)
        (file,) = (path for path in part.iterdir() if path.suffix != ".yaml")
        file.rename(bag / file.name)
    assert seen(bag) == FLIGHT
    assert "could not be read" not in judge(write_spec(tmp_path, PLAIN), bag).said


def test_types_of_actions_that_a_bag_does_not_define_are_those_of_a_folder(tmp_path: Path) -> None:
    bag = flight(Robot2(tmp_path / "bag", StoragePlugin.MCAP, ""))
    folder = tmp_path / "moves"
    (folder / "action").mkdir(parents=True)
    (folder / "msg").mkdir()
    (folder / "action" / "Move.action").write_text(ACTION)
    (folder / "msg" / "Point.msg").write_text("float64 y\n")
    spec = parse_spec(PLAIN, "s.yaml").spec
    assert [r.event.stream.kind for r in Bag(bag, spec, [folder])] == [kind for kind, _, _ in FLIGHT]


def test_of_a_filtered_robot_every_goal_that_clients_sent_is_judged(tmp_path: Path) -> None:
    robot = Robot2(tmp_path / "bag", StoragePlugin.MCAP)
    robot.send(10, ONE, 3.0, side="/move_mon")
    robot.send(12, ONE, 3.0)
    robot.send(20, TWO, 9.0, accepted=False, side="/move_mon")
    robot.feedback(30, ONE, 2.0)
    robot.feedback(31, ONE, 2.0, side="/move_mon")
    robot.cancel(33, ONE, side="/move_mon")
    robot.cancel(34, ONE)
    robot.result(40, ONE, 4, 0)
    robot.result(41, ONE, 4, 0, side="/move_mon")
    bag = robot.write()
    assert seen(bag, FILTERED) == [
        ("goal", ONE, None), ("reply", ONE, "accepted"), ("goal", TWO, None), ("feedback", ONE, None),
        ("cancel", ONE, None), ("result", ONE, "succeeded"),
    ]  # fmt: skip
    found = judge(write_spec(tmp_path, FILTERED), bag)
    goals = [row for row in found.rows if row["property"] == "small" and row["kind"] == "goal"]
    assert [(row["decision"], row["passed"]) for row in goals] == [("allow", True), ("deny", False)]
    others = [row for row in found.rows if row["kind"] != "goal"]
    assert {(row["decision"], row["passed"]) for row in others} == {(None, None)}


def test_where_only_goals_that_passed_were_recorded_that_is_said(tmp_path: Path) -> None:
    found = judge(write_spec(tmp_path, FILTERED), flight(Robot2(tmp_path / "bag", StoragePlugin.MCAP)))
    said = "the recording has no /move_mon/_action/send_goal/_service_event, so denied attempts are not in it"
    assert said in found.said
    assert (found.exit, found.strict) != (0, 0)


def test_replies_and_results_whose_request_is_not_there_are_told_and_not_guessed(tmp_path: Path) -> None:
    robot = Robot2(tmp_path / "bag", StoragePlugin.MCAP)
    robot.result(10, ONE, 4, 0)
    robot._rows.pop(0)
    robot.feedback(20, ONE, 2.0)
    found = judge(write_spec(tmp_path, PLAIN), robot.write())
    assert found.summary["events"] == 1
    assert "get_result/_service_event: none of its 1 message could be read" in found.said


def one() -> Typestore:
    store = get_typestore(Stores.ROS1_NOETIC)
    texts = {
        "MoveGoal": "float64 x\nmoves/Point at\n", "MoveResult": "int32 code\n", "MoveFeedback": "float64 left\n",
        "Point": "float64 y\n",
        "MoveActionGoal": "std_msgs/Header header\nactionlib_msgs/GoalID goal_id\nmoves/MoveGoal goal\n",
        "MoveActionResult": "std_msgs/Header header\nactionlib_msgs/GoalStatus status\nmoves/MoveResult result\n",
        "MoveActionFeedback": "std_msgs/Header header\nactionlib_msgs/GoalStatus status\nmoves/MoveFeedback feedback\n",
    }  # fmt: skip
    found: dict[str, Any] = {}
    for name, text in texts.items():
        found |= get_types_from_msg(text, f"moves/msg/{name}")
    store.register(found)
    return store


def flight1(path: Path, start: int = 0, stop: int = 10_000) -> Path:
    """The same on ROS 1, where a server says by a status that it has taken a goal."""
    store = one()
    make = {name.rpartition("/")[2]: found for name, found in store.types.items()}
    make["Time"] = store.types["builtin_interfaces/msg/Time"]

    def header(at: int) -> Any:
        return make["Header"](seq=at, stamp=make["Time"](sec=BASE // 10**9, nanosec=at * MS), frame_id="")

    def goal_id(name: str) -> Any:
        return make["GoalID"](stamp=make["Time"](sec=5, nanosec=0), id=name)

    def status(name: str, code: int) -> Any:
        return make["GoalStatus"](goal_id=goal_id(name), status=code, text="")

    def goal(at: int, name: str, x: float) -> Any:
        inner = make["MoveGoal"](x=x, at=make["Point"](y=1.5))
        return make["MoveActionGoal"](header=header(at), goal_id=goal_id(name), goal=inner)

    def array(at: int, **codes: int) -> Any:
        entries = [status(name, code) for name, code in codes.items()]
        return make["GoalStatusArray"](header=header(at), status_list=entries)

    feedback = make["MoveActionFeedback"](
        header=header(20), status=status("a", 1), feedback=make["MoveFeedback"](left=2.5)
    )
    result = make["MoveActionResult"](header=header(51), status=status("a", 2), result=make["MoveResult"](code=7))
    refused = make["MoveActionResult"](header=header(31), status=status("b", 5), result=make["MoveResult"](code=0))
    rows: list[tuple[str, str, int, Any]] = [
        ("/move/goal", "moves/msg/MoveActionGoal", 10, goal(10, "a", 3.0)),
        ("/move/status", "actionlib_msgs/msg/GoalStatusArray", 11, array(11, a=0)),
        ("/move/status", "actionlib_msgs/msg/GoalStatusArray", 12, array(12, a=1)),
        ("/move/status", "actionlib_msgs/msg/GoalStatusArray", 13, array(13, a=1)),
        ("/move/feedback", "moves/msg/MoveActionFeedback", 20, feedback),
        ("/move/goal", "moves/msg/MoveActionGoal", 30, goal(30, "b", 9.0)),
        ("/move/result", "moves/msg/MoveActionResult", 31, refused),
        ("/move/status", "actionlib_msgs/msg/GoalStatusArray", 32, array(32, a=1, b=5)),
        ("/move/cancel", "actionlib_msgs/msg/GoalID", 40, make["GoalID"](stamp=make["Time"](sec=0, nanosec=0), id="")),
        ("/move/status", "actionlib_msgs/msg/GoalStatusArray", 50, array(50, a=2, b=5)),
        ("/move/result", "moves/msg/MoveActionResult", 51, result),
    ]
    with Writer1(path) as writer:
        ids: dict[str, Any] = {}
        for topic, type_, at, message in rows:
            if not start <= at < stop:
                continue
            if topic not in ids:
                ids[topic] = writer.add_connection(topic, type_, typestore=store)
            writer.write(ids[topic], BASE + at * MS, store.serialize_ros1(message, type_))
    return path


def test_the_topics_of_ros_1_are_events_of_the_action(tmp_path: Path) -> None:
    bag = flight1(tmp_path / "move.bag")
    assert seen(bag) == [
        ("goal", "a", None), ("status", "a", "unknown"), ("reply", "a", "accepted"), ("status", "a", "executing"),
        ("feedback", "a", None), ("goal", "b", None), ("reply", "b", "rejected"), ("result", "b", "rejected"),
        ("status", "b", "rejected"), ("cancel", "", None), ("status", "a", "canceled"), ("result", "a", "canceled"),
    ]  # fmt: skip
    parts = tmp_path / "split"
    parts.mkdir()
    flight1(parts / "s_0.bag", 0, 32)
    flight1(parts / "s_1.bag", 32, 51)
    flight1(parts / "s_2.bag", 51)
    assert seen(parts) == seen(bag)
    found = list(events(bag))
    assert [e.data for e in found if e.stream.kind == "goal"] == [
        {"x": 3.0, "at": {"y": 1.5}}, {"x": 9.0, "at": {"y": 1.5}}
    ]  # fmt: skip
    assert [e.stamp for e in found if e.stream.kind == "result"] == [BASE + 31 * MS, BASE + 51 * MS]
    judged = judge(write_spec(tmp_path, PLAIN), bag)
    assert {name: state["violations"] for name, state in judged.summary["properties"].items()} == {
        "small": 1, "results_have_goals": 0
    }  # fmt: skip
