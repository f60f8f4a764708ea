"""The GitHub action judges recordings, and marks the lines of the specs."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest
import yaml

from tests.processes import ROOT
from tests.whole.harness import COMMAND, environment

ACTION = yaml.safe_load((ROOT / "action.yml").read_text())
SCRIPT = ROOT / "scripts" / "judge-recordings"
SPEC = """\
id: base
streams:
  - topic: /cmd_vel
    type: geometry_msgs/msg/Twist
    signals: {speed: msg.linear.x}
properties:
  - id: forward
    formula: '{topic: /cmd_vel} -> {speed >= 0}'
  - id: slow
    formula: '{topic: /cmd_vel} -> {speed <= 1.5}'
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A spec, a sound recording, one with a fault, and one of something else."""
    (tmp_path / "a spec.yaml").write_text(SPEC, encoding="utf-8")
    (tmp_path / "bags").mkdir()
    for name, speeds in {"1_sound": (0.5, 1.0), "2_fault": (0.5, 2.0, 2.5)}.items():
        lines = [f'{{"topic": "/cmd_vel", "time": {10 + i}, "linear": {{"x": {x}}}}}\n' for i, x in enumerate(speeds)]
        (tmp_path / "bags" / f"{name}.jsonl").write_text("".join(lines), encoding="utf-8")
    (tmp_path / "other.jsonl").write_text('{"topic": "/odom", "time": 10}\n', encoding="utf-8")
    return tmp_path


def judge(folder: Path, **inputs: str) -> subprocess.CompletedProcess[str]:
    """Run the script as the action does."""
    path = f"{COMMAND.parent}{os.pathsep}{os.environ['PATH']}"
    words = environment(PATH=path, **{name.upper(): text for name, text in inputs.items()})
    return subprocess.run([SCRIPT], cwd=folder, env=words, capture_output=True, encoding="utf-8", check=False)


def test_the_action_gives_its_inputs_to_the_script() -> None:
    *_, install, run = ACTION["runs"]["steps"]
    assert ACTION["runs"]["using"] == "composite"
    assert all(step["shell"] == "bash" for step in (install, run))
    assert run["run"].endswith(f'"$GITHUB_ACTION_PATH/{SCRIPT.relative_to(ROOT).as_posix()}"')
    assert os.access(SCRIPT, os.X_OK)
    given = {name: re.fullmatch(r"\$\{\{ inputs\.([\w-]+) \}\}", text) for name, text in run["env"].items()}
    assert {name.lower() for name in given} == {match[1] for match in given.values() if match}
    assert {name.lower() for name in given} == ACTION["inputs"].keys() - {"python-version"}
    assert all(f'"{name}"' in SCRIPT.read_text(encoding="utf-8") for name in given)


def test_a_fault_is_marked_at_the_property_of_the_spec(folder: Path) -> None:
    judged = judge(folder, specs="a spec.yaml\n", recordings="bags/*.jsonl")
    assert judged.returncode == 1, judged.stderr
    marks = [line for line in judged.stdout.splitlines() if line.startswith(("::error", "::warning"))]
    assert len(marks) == 1
    assert marks[0].startswith(
        "::error file=a spec.yaml,line=9,col=9::bags/2_fault.jsonl: slow: violated once in 1 episode, first at"
    )


@pytest.mark.parametrize("pattern", ["bags/**/*.jsonl", "**/2_*.jsonl"])
def test_a_fault_in_a_folder_below_is_found(folder: Path, pattern: str) -> None:
    """Of two stars a shell makes one unless it is told otherwise: deeper recordings were passed over in a green job."""
    deep = folder / "bags" / "monday" / "run 1"
    deep.mkdir(parents=True)
    (folder / "bags" / "2_fault.jsonl").rename(deep / "2_fault.jsonl")
    judged = judge(folder, specs="a spec.yaml\n", recordings=f"{pattern}\n")
    assert judged.returncode == 1, judged.stderr
    assert "::bags/monday/run 1/2_fault.jsonl: slow: violated once" in judged.stdout


def test_a_pattern_that_nothing_matches_fails(folder: Path) -> None:
    judged = judge(folder, specs="a spec.yaml", recordings="bags/*.jsonl\nbags/*.mcap")
    assert judged.returncode == 1
    none = judge(folder, specs="a spec.yaml", recordings="bags/*.mcap")
    assert none.returncode == 2
    assert "::error::bags/*.mcap could not be judged" in none.stdout


def test_a_recording_of_something_else_fails(folder: Path) -> None:
    other = judge(folder, specs="*.yaml", recordings="other.jsonl")
    assert other.returncode == 2
    assert "::error file=a spec.yaml,line=1,col=1::other.jsonl: has no event of base" in other.stdout


def test_an_unsound_spec_is_marked_and_nothing_is_judged(folder: Path) -> None:
    (folder / "a spec.yaml").write_text(SPEC.replace(" -> {speed <= 1.5}", " -> "), encoding="utf-8")
    judged = judge(folder, specs="a spec.yaml", recordings="bags/2_fault.jsonl")
    assert judged.returncode == 1
    assert judged.stdout.startswith("::error file=a spec.yaml,line=10,")
    assert "2_fault" not in judged.stdout


@pytest.mark.parametrize("lacking", ["specs", "recordings"])
def test_what_is_not_given_is_told(folder: Path, lacking: str) -> None:
    inputs = {"specs": "a spec.yaml", "recordings": "other.jsonl"} | {lacking: ""}
    assert (judge(folder, **inputs).returncode, judge(folder, **inputs).stdout[:9]) == (2, "::error::")
