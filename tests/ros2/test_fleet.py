"""Many robots: two UAVs in one session, each by its own names, as docs/adapters.md has it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.robot import DIAGNOSED, spec_folder
from tests.ros2.harness import ROOT, Data, Scene, eventually

msg = pytest.importorskip("std_msgs.msg")

# rclpy imports an old lark with its first node, and warns by a function of its own that is deprecated.
pytestmark = pytest.mark.filterwarnings(
    "ignore:module 'sre_:DeprecationWarning", "ignore:Deprecated in favor of:DeprecationWarning"
)


def documented() -> str:
    """The spec of the fleet in the documentation."""
    found = re.search(
        r"```yaml\n(id: fleet\n.*?)```", (ROOT / "docs" / "adapters.md").read_text(encoding="utf-8"), re.DOTALL
    )
    assert found
    return found[1]


def came(scene: Scene) -> list[Data]:
    """The first record of each event, also of attempts that were taken back, which have no step."""
    found: dict[tuple[str, int], Data] = {}
    for record in scene.server.records("s"):
        found.setdefault((record["monitor"], record["seq"]), record)
    return list(found.values())


def test_two_uavs_in_one_session_are_judged_each_by_its_own_and_by_the_others(tmp_path: Path) -> None:
    specs = tmp_path / "specs"
    specs.mkdir()
    (specs / "fleet.yaml").write_text(documented(), encoding="utf-8")
    with Scene(tmp_path, specs) as scene:
        first = scene.adapter("fleet", monitor="uav1", more=["--namespace", "/uav1"])
        second = scene.adapter(
            "fleet", monitor="uav2", more=["--remap", "/battery:=/uav2/power", "--remap", "/takeoff:=/uav2/takeoff"]
        )
        peer = scene.peer()
        batteries = [peer.publisher(msg.Float64, topic) for topic in ("/uav1/battery", "/uav2/power")]
        asked = [peer.publisher(msg.Empty, f"/{uav}/takeoff_mon") for uav in ("uav1", "uav2")]
        heard = {uav: peer.record(msg.Empty, f"/{uav}/takeoff") for uav in ("uav1", "uav2")}
        peer.until(lambda: all(peer.node.count_publishers(f"/{uav}/takeoff") for uav in heard))

        def say(publisher: object, message: object) -> None:
            count = len(came(scene))
            publisher.publish(message)  # type: ignore[attr-defined]
            eventually(lambda: came(scene), lambda found: len(found) == count + 1)

        say(batteries[0], msg.Float64(data=20.0))
        say(batteries[1], msg.Float64(data=90.0))
        say(asked[0], msg.Empty())  # the leader is not charged
        say(asked[1], msg.Empty())  # so that it is not up
        say(batteries[0], msg.Float64(data=90.0))
        say(asked[0], msg.Empty())
        peer.until(lambda: heard["uav1"])
        say(batteries[1], msg.Float64(data=20.0))
        say(asked[1], msg.Empty())
        say(batteries[1], msg.Float64(data=70.0))
        say(asked[1], msg.Empty())
        peer.until(lambda: heard["uav2"])
        assert {uav: len(messages) for uav, messages in heard.items()} == {"uav1": 1, "uav2": 1}
        events = [(e["monitor"], e["stream"], e["decision"]) for e in came(scene)]
        assert events == [
            ("uav1", "/battery", None),
            ("uav2", "/battery", None),
            ("uav1", "/takeoff", "deny"),
            ("uav2", "/takeoff", "deny"),
            ("uav1", "/battery", None),
            ("uav1", "/takeoff", "allow"),
            ("uav2", "/battery", None),
            ("uav2", "/takeoff", "deny"),
            ("uav2", "/battery", None),
            ("uav2", "/takeoff", "allow"),
        ]
        second.said("denied a message of /takeoff: leader_first")
        second.said("denied a message of /takeoff: charged_takeoff")
        first.ends_well()
        second.ends_well()


@pytest.mark.parametrize("monitor", ["7", "~/7.b"])
def test_a_monitor_may_be_named_as_no_node_may(monitor: str, tmp_path: Path) -> None:
    specs = tmp_path / "specs"
    specs.mkdir()
    (specs / "fleet.yaml").write_text(documented(), encoding="utf-8")
    with Scene(tmp_path, specs) as scene:
        adapter = scene.adapter("fleet", monitor=monitor)
        assert [found["name"] for found in scene.server.session("s")["monitors"]] == [monitor]
        adapter.ends_well()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--remap", "/batery:=/uav1/battery"], "--remap /batery: fleet has no such stream"),
        (["--remap", "/battery"], "'/battery' is no remap like"),
        (["--remap", "/takeoff:=/battery"], "--remap: /battery and /takeoff would both be /battery here"),
        (["--remap", "/battery:=/rosout"], "/battery can't be observed as std_msgs/msg/Float64: "),
        (
            ["--ros-args", "-r", "/takeoff:=/takeoff_mon"],
            "/takeoff and its proxy /takeoff_mon would both be /takeoff_mon here",
        ),
        (["--namespace", "uav 1"], "'uav 1' is no namespace like"),
    ],
)
def test_a_remap_that_means_nothing_is_refused(words: list[str], told: str, tmp_path: Path) -> None:
    specs = tmp_path / "specs"
    specs.mkdir()
    (specs / "fleet.yaml").write_text(documented(), encoding="utf-8")
    with Scene(tmp_path, specs) as scene:
        with pytest.raises(AssertionError, match="did not say 'observing'") as failed:
            scene.adapter("fleet", more=words)
        assert told in str(failed.value)
        assert "Traceback" not in str(failed.value)


def test_what_the_adapter_says_itself_is_not_filtered(tmp_path: Path) -> None:
    specs = spec_folder(tmp_path, DIAGNOSED, intercept="subscriber", unavailable="deny", within="2s")
    with Scene(tmp_path, specs) as scene:
        with pytest.raises(AssertionError, match="did not say 'observing'") as failed:
            scene.adapter("gate")
        told = "/diagnostics can't be filtered by intercept: subscriber: the adapter itself speaks there"
        assert told in str(failed.value)
        assert "Traceback" not in str(failed.value)
