"""The case studies: their recordings are what their simulators write, and are judged as their READMEs say."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from oracle_server.replay.opening import open_recording
from oracle_server.replay.run import Replay
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.load import load_spec, parse_spec

EXAMPLES = Path(__file__).parents[2] / "examples"
BROKEN = {
    "rover": {"reports_are_of_visits": 1, "no_approach_into_danger": 1, "leaves_when_too_hot": 1},
    "turtle": {"no_speeding": 1, "slow_at_the_edge": 13, "teleported_inside_only": 1},
    "manipulator": {"slow_near_a_person": 18, "sees_where_it_goes": 1},
    "lifecycle": {"lifecycle_ok": 2, "commands_while_active": 1},
    "modes": {"modes_ok": 1, "leases_ok": 1, "driven_in_its_modes": 2},
}


def simulator(name: str) -> Callable[..., Iterator[str]]:
    place = importlib.util.spec_from_file_location(f"{name}_simulator", EXAMPLES / name / "simulator.py")
    assert place
    assert place.loader
    module = importlib.util.module_from_spec(place)
    place.loader.exec_module(module)
    found: Callable[..., Iterator[str]] = module.trace
    return found


def replayed(name: str, trace: str, types: Types | None = None) -> tuple[Replay, list[Any]]:
    loaded = load_spec(EXAMPLES / name / f"{name}.yaml", types=types)
    assert loaded.warnings == ()
    replay = Replay(loaded.spec, open_recording(EXAMPLES / name / "traces" / f"{trace}.jsonl", loaded.spec))
    return replay, list(replay)


@pytest.mark.parametrize("name", BROKEN)
@pytest.mark.parametrize("trace", ["sound", "fault"])
def test_a_recording_is_what_the_simulator_writes(name: str, trace: str) -> None:
    recorded = (EXAMPLES / name / "traces" / f"{trace}.jsonl").read_text().splitlines()
    assert recorded == list(simulator(name)(fault=trace == "fault"))


@pytest.mark.parametrize("name", BROKEN)
def test_a_sound_run_breaks_nothing(name: str) -> None:
    replay, judged = replayed(name, "sound")
    assert not replay.violated
    assert {v.outcome.value for item in judged for v in item.verdicts} == {"currently_true"}
    assert all(item.decision is None or item.decision.choice == "allow" for item in judged)


@pytest.mark.parametrize("name", BROKEN)
def test_a_faulty_run_breaks_what_its_readme_says(name: str) -> None:
    replay, _ = replayed(name, "fault")
    broken = {n: state["violations"] for n, state in replay.states().items() if state["violations"]}
    assert broken == BROKEN[name]
    assert replay.summary()["late"] == 0


def test_that_something_has_lasted_is_not_said_by_historically() -> None:
    """After a pause its window holds the newest messages only: what the example's README warns of."""
    path = EXAMPLES / "manipulator"
    text = (path / "manipulator.yaml").read_text()
    careless = text.replace("{near} since[0.3:] {near}", "historically[0:0.3]{near}")
    assert careless != text
    spec = parse_spec(careless, "careless.yaml").spec
    replay = Replay(spec, open_recording(path / "traces" / "sound.jsonl", spec))
    assert len(list(replay)) > 0
    assert replay.states()["slow_near_a_person"]["violations"] > 0


def test_the_rover_is_not_sent_on_into_the_leak() -> None:
    _, judged = replayed("rover", "fault")
    found = next(
        item for item in judged for v in item.verdicts if v.property == "no_approach_into_danger" and v.explanation
    )
    assert found.step.event.data == {"action": "approach", "drum": 5}


def test_the_turtle_is_held_back_each_time() -> None:
    _, judged = replayed("turtle", "fault")
    denied = [item for item in judged if item.decision and item.decision.choice == "deny"]
    by_stream = {
        name: sum(i.step.event.stream.name == name for i in denied)
        for name in ("/turtle1/cmd_vel", "/turtle1/teleport_absolute")
    }
    recorded = (json.loads(line) for line in (EXAMPLES / "turtle" / "traces" / "fault.jsonl").read_text().splitlines())
    speeding = sum(line["data"]["linear"]["x"] > 2 for line in recorded if line["stream"] == "/turtle1/cmd_vel")
    assert by_stream == {
        "/turtle1/cmd_vel": speeding + BROKEN["turtle"]["slow_at_the_edge"],
        "/turtle1/teleport_absolute": 1,
    }


@pytest.mark.parametrize(("name", "withheld"), [("lifecycle", 5), ("modes", 2)])
def test_what_a_machine_does_not_allow_is_held_back(name: str, withheld: int) -> None:
    _, judged = replayed(name, "fault")
    assert sum(item.decision is not None and item.decision.choice == "deny" for item in judged) == withheld


def test_the_base_is_not_sent_away_with_its_arm_out() -> None:
    """Its recordings are of real nodes."""
    types = Types([EXAMPLES / "navigation" / "ros2" / "navigation_msgs"], {})
    sound, judged = replayed("navigation", "sound", types)
    assert not sound.violated
    assert {item.step.event.stream.kind for item in judged} >= {"goal", "reply", "feedback", "cancel", "result"}
    faulty, judged = replayed("navigation", "fault", types)
    broken = {n: state["violations"] for n, state in faulty.states().items() if state["violations"]}
    assert broken == {"arm_is_stowed": 1}
    denied = [item.step.event.stream.kind for item in judged if item.decision and item.decision.choice == "deny"]
    assert denied == ["goal"]
