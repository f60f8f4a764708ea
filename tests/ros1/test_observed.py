"""What the ROS 1 adapter hears and shows: any type, stamps and their sources, simulated time, verdicts on the graph."""

from __future__ import annotations

import importlib
import json
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PointStamped
from oracle_ros1.stamps import stamp_reader
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64, Int64, String

from tests.processes import SERVER, environment, eventually
from tests.robot import DIAGNOSED, GATE, settled, spec_folder
from tests.ros1.harness import Peer, Scene

SECOND = 10**9
WATCH = """
id: watch
description: Points with a stamp, numbers without
streams:
  - topic: /number
    type: std_msgs/Int64
  - topic: /point
    type: geometry_msgs/PointStamped
properties:
  - id: small
    formula: 'not {topic: "/number", data > 100}'
  - id: not_negative
    formula: 'historically not {topic: "/number", data < 0}'
"""
ODD = """
id: odd
description: Messages of a package that is not installed here
streams:
  - topic: /odd
    type: odd_msgs/Odd
    action: filter
    intercept: publisher
    signals: {answer: msg.inner.answer, size: size(msg.blob)}
properties:
  - id: no_13
    formula: 'not {topic: "/odd", answer: 13}'
    guards: [/odd]
"""


def generated(folder: Path) -> Path:
    """Where the package `odd_msgs` can be imported from, by those who are told."""
    source, made = folder / "odd_msgs", folder / "generated"
    (source / "msg").mkdir(parents=True)
    (source / "msg" / "Inner.msg").write_text("int64 answer\n", encoding="utf-8")
    (source / "msg" / "Odd.msg").write_text("Header header\nInner inner\nuint8[] blob\n", encoding="utf-8")
    output = made / "odd_msgs"
    output.mkdir(parents=True)
    (output / "__init__.py").touch()
    include = ["-I", f"odd_msgs:{source}/msg", "-I", "std_msgs:/usr/share/std_msgs/msg"]
    files = sorted((source / "msg").iterdir())
    for words in ([*include, "-o", output / "msg", *files], ["--initpy", "-o", output / "msg"]):
        command = [sys.executable, "/usr/lib/genpy/genmsg_py.py", "-p", "odd_msgs", *words]
        subprocess.run([str(word) for word in command], check=True)
    return made


class Seen:
    """What a node hears of a monitor."""

    def __init__(self, peer: Peer, monitor: str) -> None:
        self.peer, self._own = peer, monitor
        peer.record(String, f"{monitor}/monitor_verdict", speakers=1)
        peer.record(String, f"{monitor}/monitor_error", speakers=1)
        peer.record(DiagnosticArray, "/diagnostics", speakers=1)

    def said(self, what: str) -> list[str]:
        return [message.data for message in self.peer.heard(f"{self._own}/{what}")]

    def verdict(self, outcome: str) -> None:
        """Wait until this is the verdict."""
        self.peer.until(
            lambda: self.said("monitor_verdict")[-1:] == [outcome], lambda: f"{outcome}: {self.said('monitor_verdict')}"
        )

    def error(self, *parts: str) -> None:
        """Wait for an error with all of these in its text."""
        self.peer.until(
            lambda: any(all(part in text for part in parts) for text in self.said("monitor_error")),
            lambda: f"{parts}: {self.said('monitor_error')}",
        )

    def levels(self, **wanted: int) -> None:
        """Wait until the diagnostics have these levels."""

        def found() -> dict[str, Any]:
            heard = self.peer.heard("/diagnostics")[-1:]
            return {s.name.partition(": ")[2]: s.level for array in heard for s in array.status}

        self.peer.until(lambda: wanted.items() <= found().items(), lambda: f"{wanted}: {found()}")


def test_the_graph_sees_verdicts_errors_and_diagnostics(tmp_path: Path) -> None:
    ok, warn, error, stale = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR, DiagnosticStatus.STALE
    with Scene(tmp_path, spec_folder(tmp_path, WATCH)) as scene:
        adapter, peer = scene.adapter("watch", monitor="/fleet/uav-1"), scene.peer()
        seen = Seen(peer, "/fleet/uav_1")
        peer.advertise(Int64, "/number")
        seen.verdict("unknown")
        seen.levels(oracle=ok, small=stale, not_negative=stale)
        peer.publish("/number", Int64(1))
        seen.verdict("currently_true")
        seen.levels(oracle=ok, small=ok, not_negative=ok)
        peer.publish("/number", Int64(101))
        seen.verdict("currently_false")
        seen.levels(small=warn, not_negative=ok)
        seen.error("violation", "small", "/number (topic", "data > 100")
        peer.publish("/number", Int64(-1))
        seen.verdict("false")
        seen.levels(small=ok, not_negative=error)
        scene.server.kill()
        seen.verdict("unknown")
        seen.levels(oracle=stale, small=stale, not_negative=stale)
        scene.server.restart()
        late = Seen(scene.peer(), "/fleet/uav_1")  # who comes later sees how it stands
        late.verdict("false")
        late.levels(oracle=ok, not_negative=error)
        adapter.ends_well()


def test_what_the_installed_type_does_not_have_is_told(tmp_path: Path) -> None:
    lacking = "battery_uav_msgs/BatteryStatus\n    stamp: header.stmp\n    signals: {x: msg.header.sek + msg.status}\n"
    with Scene(tmp_path, spec_folder(tmp_path, WATCH.replace("geometry_msgs/PointStamped\n", lacking))) as scene:
        told = (
            "battery_uav_msgs/BatteryStatus has no time at `header.stmp`: ordered by arrival instead; "
            "the spec reads msg.header.sek, which battery_uav_msgs/BatteryStatus does not have here"
        )
        scene.adapter("watch").said(f"/point: {told}")

        def trouble() -> list[str]:
            [monitor] = scene.server.session("s")["monitors"]
            return [s["trouble"] for s in monitor["streams"] if s["stream"] == "/point"]

        eventually(trouble, lambda found: found == [told])


def test_where_stamps_come_from_is_known_and_shown(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, WATCH)) as scene:
        scene.adapter("watch")
        peer = scene.peer()
        peer.advertise(Int64, "/number")
        peer.advertise(PointStamped, "/point")
        stamped = PointStamped()
        stamped.header.stamp.secs, stamped.header.stamp.nsecs = 1_700_000_000, 5
        began = time.time_ns()
        peer.publish("/number", Int64(1))
        peer.publish("/point", PointStamped(), stamped)
        events = eventually(lambda: scene.server.events("s"), lambda found: len(found) == 3)
        ended = time.time_ns()
        [number], (unset, old) = (
            sorted((e for e in events if e["stream"] == name), key=lambda e: e["seq"]) for name in ("/number", "/point")
        )
        assert all(began <= event["stamp"] <= event["arrived"] <= ended for event in (number, unset))
        assert old["stamp"] == 1_700_000_000 * 10**9 + 5
        [monitor] = scene.server.session("s")["monitors"]
        assert {s["stream"]: s["time_source"] for s in monitor["streams"]} == {"/number": "arrival", "/point": "field"}


def test_a_topic_whose_package_is_not_installed_is_read_and_filtered(tmp_path: Path) -> None:
    made = generated(tmp_path)
    with Scene(tmp_path, spec_folder(tmp_path, ODD)) as scene:
        adapter = scene.adapter("odd")
        scene.settings["PYTHONPATH"] = f"{made}:{environment()['PYTHONPATH']}"
        script = tmp_path / "odd.py"
        script.write_text(ODD_NODES, encoding="utf-8")
        hearer = scene.run("hearer", sys.executable, script, "hear")
        speaker = scene.run("speaker", sys.executable, script, "speak")
        hearer.said(r"heard \[12, 14\] 3 bytes odd_frame")
        assert speaker.running
        events = settled(scene.server, 3)
        assert [(event["decision"], event["passed"]) for event in events] == [
            ("allow", True),
            ("deny", False),
            ("allow", True),
        ]
        [monitor] = scene.server.session("s")["monitors"]
        assert [s["time_source"] for s in monitor["streams"]] == ["field"]
        adapter.ends_well()


ODD_NODES = """
import sys
from xmlrpc.client import ServerProxy
import rospy
from odd_msgs.msg import Inner, Odd
from std_msgs.msg import Header

rospy.init_node(sys.argv[1])
if sys.argv[1] == "hear":
    heard = []
    rospy.Subscriber("/odd", Odd, heard.append)
    while len(heard) < 2:
        rospy.sleep(0.02)
    answers = [odd.inner.answer for odd in heard]
    print(f"heard {answers} {len(heard[0].blob)} bytes {heard[0].header.frame_id}", flush=True)
else:
    publisher = rospy.Publisher("/odd_mon", Odd, queue_size=10)
    adapter = ServerProxy(rospy.get_master().lookupNode("/uav1")[2])
    heard = False
    while not (publisher.get_num_connections() and heard):
        rospy.sleep(0.02)
        heard = any((way, topic) == ("o", "/odd") for _, _, way, _, topic, *_ in adapter.getBusInfo("/speak")[2])
    for answer in (12, 13, 14):
        header = Header(stamp=rospy.Time.now(), frame_id="odd_frame")
        publisher.publish(Odd(header=header, inner=Inner(answer), blob=b"abc"))
rospy.spin()
"""


class World:
    """A simulated world with a clock."""

    def __init__(self, scene: Scene) -> None:
        self._scene, self.peer = scene, scene.peer()
        self.peer.parameter("/use_sim_time", True)
        self._adapter = scene.adapter("watch")
        self.peer.advertise(Clock, "/clock")
        self.peer.advertise(Int64, "/number")
        self.peer.advertise(PointStamped, "/point")

    def at(self, seconds: int, session: str = "s") -> None:
        """Set the world's time, and wait until the session has heard of it."""
        self.peer.publish("/clock", Clock(rospy.Time(seconds)))
        eventually(lambda: self._frontier(session), lambda at: at == seconds * SECOND)

    def back_to(self, seconds: int) -> None:
        """Set the world's time back, and wait for the new session."""
        self.peer.publish("/clock", Clock(rospy.Time(seconds)))
        self._adapter.said(r"attached s\.run2")

    def say(self, number: int, seconds: int, session: str = "s") -> None:
        """Publish a point with a stamp, and a number without, which has arrived when this returns."""
        before = self._taken(session)
        point = PointStamped()
        point.header.stamp.secs = seconds
        self.peer.publish("/point", point)
        self.peer.publish("/number", Int64(number))
        eventually(lambda: self._taken(session), lambda taken: taken == before + 2)

    def _taken(self, session: str) -> int:
        return int(self._scene.server.session(session)["monitors"][0]["next"])

    def _frontier(self, session: str) -> int:
        streams = self._scene.server.session(session)["streams"]
        return next((s["frontier"] for s in streams if s["stream"] == "/number"), 0)


@pytest.mark.parametrize("back", [5, 0])  # 0: as where a simulated world is reset, and stands
def test_stamps_follow_simulated_time_and_a_jump_back_begins_a_new_session(back: int, tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, WATCH)) as scene:
        world = World(scene)
        for number in range(3):
            world.at(10 + number)
            world.say(number, 10 + number)
        world.at(13)
        events = eventually(lambda: scene.server.events("s"), lambda found: len(found) == 6)
        assert [event["stamp"] // SECOND for event in events] == [10, 10, 11, 11, 12, 12]
        world.back_to(back)
        assert scene.server.session("s")["status"] == "closed"
        world.say(7, back, "s.run2")
        world.at(6, "s.run2")
        again = eventually(lambda: scene.server.events("s.run2"), lambda found: len(found) == 2)
        assert [event["stamp"] // SECOND for event in again] == [back, back]
        assert not any(event["late"] or event["skewed"] for event in events + again)


def test_simulated_time_that_nobody_tells_is_told(tmp_path: Path) -> None:
    """As where the parameter is left from a bag that was played: no deadline runs out."""
    with Scene(tmp_path, spec_folder(tmp_path, WATCH)) as scene:
        peer = scene.peer()
        peer.parameter("/use_sim_time", True)
        adapter = scene.adapter("watch")
        adapter.said("simulated time: time stands at 0, so no deadline runs out: /clock is silent, or paused")
        peer.advertise(Clock, "/clock")
        peer.publish("/clock", Clock(rospy.Time(10)))
        adapter.said("simulated time: recovered")
        adapter.said(r"simulated time: time stands at 10\.000 s, so no deadline runs out")
        eventually(lambda: scene.server.session("s")["monitors"], lambda found: "time stands at 10" in str(found))


def test_two_uavs_in_one_session_have_their_own_names(tmp_path: Path) -> None:
    documented = (Path(__file__).parents[2] / "docs" / "adapters.md").read_text(encoding="utf-8")
    text = re.search(r"```yaml\n(id: fleet\n.*?)```", documented, re.DOTALL)
    assert text
    with Scene(tmp_path, spec_folder(tmp_path, text[1])) as scene:
        scene.adapter("fleet", monitor="uav1", more=["--namespace", "/uav1"])
        scene.adapter(
            "fleet", monitor="uav2", more=["--remap", "/battery:=/uav2/power", "--remap", "/takeoff:=/uav2/takeoff"]
        )
        peer = scene.peer()
        peer.advertise(Float64, "/uav1/battery")
        peer.advertise(Float64, "/uav2/power")
        peer.publish("/uav1/battery", Float64(90.0))
        peer.publish("/uav2/power", Float64(20.0))
        events = eventually(lambda: scene.server.events("s"), lambda found: len(found) == 2)
        assert {(e["monitor"], e["stream"]) for e in events} == {("uav1", "/battery"), ("uav2", "/battery")}


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--spec", "nothing"], "unknown_spec: "),
        (["--spec", "gate", "--remap", "/nothing:=/something"], "--remap /nothing: gate has no such stream"),
        (["--spec", "gate", "--remap", "nonsense"], "'nonsense' is no remap like"),
        (["--spec", "gate", "--oracle", "ftp://nowhere"], "is no address like"),
        (
            ["--spec", "gate", "--remap", "/number:=/diagnostics"],
            "/number can't be observed as std_msgs/Int64: this node itself publishes diagnostic_msgs/DiagnosticArray",
        ),
    ],
)
def test_an_adapter_that_cannot_start_says_why(words: list[str], told: str, tmp_path: Path) -> None:
    specs = spec_folder(tmp_path, GATE, intercept="publisher", unavailable="deny", within="2s")
    with Scene(tmp_path, specs) as scene:
        adapter = scene.run("adapter", sys.executable, "-m", "oracle_ros1", "--oracle", scene.server.url, *words)
        adapter.said(re.escape(told))
        eventually(lambda: adapter.running, lambda running: not running)
        assert adapter.end() == 2
        assert "Traceback" not in adapter.log


def test_what_the_adapter_says_itself_is_not_filtered(tmp_path: Path) -> None:
    specs = spec_folder(tmp_path, DIAGNOSED, intercept="subscriber", unavailable="deny", within="2s")
    with Scene(tmp_path, specs) as scene:
        words = ["--oracle", scene.server.url, "--spec", "gate"]
        adapter = scene.run("adapter", sys.executable, "-m", "oracle_ros1", *words)
        adapter.said(re.escape("/diagnostics can't be filtered by intercept: subscriber: the adapter itself speaks"))
        eventually(lambda: adapter.running, lambda running: not running)
        assert adapter.end() == 2
        assert "Traceback" not in adapter.log


def test_a_private_parameter_stands_for_an_option(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, WATCH)) as scene:
        words = [f"_oracle:={scene.server.url}", "_spec:=watch", "_session:=flight", "_monitor:=uav7", "__name:=other"]
        adapter = scene.run("adapter", sys.executable, "-m", "oracle_ros1", *words)
        adapter.said("observing 2 streams for session flight")
        assert [monitor["name"] for monitor in scene.server.session("flight")["monitors"]] == ["uav7"]
        adapter.ends_well()


def test_check_knows_which_of_ros_own_types_hold_no_time(tmp_path: Path) -> None:
    packages = ("std_msgs", "geometry_msgs", "sensor_msgs", "nav_msgs", "diagnostic_msgs", "rosgraph_msgs")
    modules = [importlib.import_module(f"{package}.msg") for package in packages]
    kinds = [kind for module in modules for kind in vars(module).values() if hasattr(kind, "_type")]
    streams = [f"  - {{topic: /a{i}, type: {kind._type}}}" for i, kind in enumerate(kinds)]
    spec = tmp_path / "types.yaml"
    spec.write_text(
        "\n".join(["id: types", "streams:", *streams, "properties: [{id: p, formula: 'not {topic: \"/a0\"}'}]", ""]),
        encoding="utf-8",
    )
    told = subprocess.run([SERVER, "check", "--ros", "1", spec], capture_output=True, text=True, check=True).stderr
    warned = [kind._type for i, kind in enumerate(kinds) if f"/a{i} is ordered by its arrival" in told]
    assert warned == [kind._type for kind in kinds if stamp_reader(kind, None) is None]


def test_a_dump_of_the_graph_leaves_an_adapter_of_the_same_name_alone(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, WATCH)) as scene:
        adapter = scene.adapter("watch", monitor="monitor")
        dump = scene.run("dump", sys.executable, "-m", "oracle_ros1", "--dump-graph")
        assert dump.wait() == 0
        assert "/monitor" in [node["name"] for node in json.loads(dump.log)["nodes"]]
        adapter.ends_well()


def test_the_graph_can_be_dumped(tmp_path: Path) -> None:
    with Scene(tmp_path) as scene:
        peer = scene.peer()
        peer.record(Int64, "/heard")
        peer.advertise(Int64, "/said", listeners=0)
        dump = scene.run("dump", sys.executable, "-m", "oracle_ros1", "--dump-graph", "--monitor", "dumper")
        found = json.loads(dump.said(r"(?ms)^\{$.*^\}$")[0])
        node = {node["name"]: node for node in found["nodes"]}["/peer0"]
        assert (node["publishes"], node["subscribes"]) == (
            {"/said": ["std_msgs/Int64"]},
            {"/heard": ["std_msgs/Int64"]},
        )
        assert "/dumper" not in [node["name"] for node in found["nodes"]]
