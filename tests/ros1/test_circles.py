"""Two monitors of which each gives back what the other one passes, on real ROS 1."""

from __future__ import annotations

from pathlib import Path

from std_msgs.msg import Int64

from tests.processes import eventually
from tests.ros1.harness import Scene

SPEC = """
id: SPEC
description: Commands are small
streams:
  - topic: NAME
    type: std_msgs/Int64
    action: filter
    intercept: SIDE
    signals: {value: msg.data}
properties:
  - {id: small, formula: '{topic: "NAME"} -> {value < 100}', guards: [NAME]}
"""
FOREVER = "would come round for ever"


def scene_of(folder: Path, *guards: tuple[str, str, str]) -> Scene:
    """Specs by their ids, each of a topic that is guarded at one side."""
    specs = folder / "specs"
    specs.mkdir()
    for name, topic, side in guards:
        text = SPEC.replace("SPEC", name).replace("NAME", topic).replace("SIDE", side)
        (specs / f"{name}.yaml").write_text(text)
    return Scene(folder, specs)


def bypass(scene: Scene, session: str) -> str:
    [monitor] = scene.server.session(session)["monitors"]
    return str(monitor["streams"][0]["bypass"])


def test_what_two_monitors_of_one_topic_pass_to_each_other_goes_round_once(tmp_path: Path) -> None:
    with scene_of(tmp_path, ("before", "/cmd", "publisher"), ("behind", "/cmd", "subscriber")) as scene:
        before, behind = (scene.adapter(name, session=name, monitor=name) for name in ("before", "behind"))
        pilot, base = scene.peer(), scene.peer()
        base.record(Int64, "/cmd", speakers=1)
        pilot.advertise(Int64, "/cmd_mon")
        before.said(f"/behind is a monitor that hears /cmd and gives /cmd_mon: .* {FOREVER}")
        behind.said(f"/before is a monitor that hears /cmd_mon and gives /cmd: .* {FOREVER}")
        for number in range(5):
            pilot.publish("/cmd_mon", Int64(data=number))
            base.heard("/cmd", number + 1)
        assert [said.data for said in base.heard("/cmd")] == [*range(5)]
        assert [e["decision"] for e in scene.server.events("before")] == ["allow"] * 5
        assert scene.server.events("behind") == []
        for session in ("before", "behind"):
            eventually(lambda session=session: bypass(scene, session), lambda text: FOREVER in text)
        before.ends_well()
        eventually(lambda: bypass(scene, "behind"), lambda text: FOREVER not in text)
        behind.ends_well()


def test_one_monitor_behind_another_is_no_circle(tmp_path: Path) -> None:
    with scene_of(tmp_path, ("first", "/cmd_mon", "publisher"), ("second", "/cmd", "publisher")) as scene:
        adapters = [scene.adapter(name, session=name, monitor=name) for name in ("first", "second")]
        pilot, base = scene.peer(), scene.peer()
        base.record(Int64, "/cmd", speakers=1)
        base.record(Int64, "/cmd_mon", speakers=1)
        pilot.advertise(Int64, "/cmd_mon_mon")
        pilot.publish("/cmd_mon_mon", Int64(data=1))
        assert [said.data for said in base.heard("/cmd", 1)] == [1]
        assert not any(FOREVER in adapter.log for adapter in adapters)
