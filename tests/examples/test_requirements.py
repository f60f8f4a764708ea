"""The twelve requirements: their recordings are what the simulator writes, and are judged as expected, and as read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from examples.requirements import simulator
from oracle_server.core.verdicts import record
from oracle_server.replay.opening import open_recording
from oracle_server.replay.run import Replay
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.load import load_spec
from tests.examples.plainly import READINGS, Wrong, read

FOLDER = Path(simulator.__file__).parent
TYPES = Types([FOLDER / "types"], {})
EXPECTED: dict[str, dict[str, list[dict[str, Any]]]] = json.loads((FOLDER / "expected.json").read_text())
RECORDINGS = [(run.__name__, name) for run, faults in simulator.RUNS.items() for name in ("sound", *faults)]
MICROSECOND = 1000


def recorded(requirement: str, recording: str) -> Path:
    return FOLDER / "traces" / requirement / f"{recording}.jsonl"


def judged(requirement: str, path: Path) -> list[dict[str, Any]]:
    """The violations that a replay finds, as `expected.json` has them: times in seconds since the start."""
    loaded = load_spec(FOLDER / f"{requirement}.yaml", types=TYPES)
    assert loaded.warnings == ()
    replay = Replay(loaded.spec, open_recording(path, loaded.spec))
    records = [record(row, verdict) for row in replay for verdict in row.verdicts]
    assert replay.summary()["late"] == 0
    assert {r["property"] for r in records if r["outcome"] == "unknown"} <= {"all_are_there"}  # its grace
    return [
        {
            "property": r["property"],
            "step": r["step"],
            "at": (r["stamp"] - simulator.START) // MICROSECOND / 10**6,
            **({"about": [about["step"] for about in r["about"]]} if r["about"] else {}),
        }
        for r in records
        if r["violation"]
    ]


def told(violations: list[dict[str, Any]]) -> list[Wrong]:
    """The same as a plain reading has them, in its order."""
    return sorted(Wrong(v["property"], round(v["at"] * 10**6), tuple(v.get("about", ()))) for v in violations)


def plainly(requirement: str, path: Path) -> list[Wrong]:
    """What plain Python finds, with times in microseconds since the start."""
    found = READINGS[requirement](read(path))
    return sorted(wrong._replace(time=(wrong.time - simulator.START) // MICROSECOND) for wrong in found)


def test_what_is_expected_is_written_down_of_each_recording() -> None:
    assert [(name, recording) for name, of_it in EXPECTED.items() for recording in of_it] == RECORDINGS
    assert all(bool(found) is (name != "sound") for of_it in EXPECTED.values() for name, found in of_it.items())
    assert {path.stem for path in FOLDER.glob("*.yaml")} == set(EXPECTED)


def test_the_recordings_are_what_the_simulator_writes() -> None:
    found = {(path.parent.name, path.stem): path.read_text() for path in FOLDER.glob("traces/*/*")}
    assert found == {(r, name): "".join(f"{line}\n" for line in lines) for r, name, lines in simulator.recordings()}


@pytest.mark.parametrize(("requirement", "recording"), RECORDINGS)
def test_a_recording_is_judged_as_expected(requirement: str, recording: str) -> None:
    assert judged(requirement, recorded(requirement, recording)) == EXPECTED[requirement][recording]


@pytest.mark.parametrize(("requirement", "recording"), RECORDINGS)
def test_what_is_expected_is_what_plain_python_finds(requirement: str, recording: str) -> None:
    assert plainly(requirement, recorded(requirement, recording)) == told(EXPECTED[requirement][recording])


@pytest.mark.parametrize("run", simulator.RUNS, ids=lambda run: run.__name__)
def test_other_runs_are_judged_as_plain_python_does(run: simulator.Run, tmp_path: Path) -> None:
    """With other rates, gaps and delays on the way, all below `max_delay`."""
    path = tmp_path / "run.jsonl"
    for seed in ("another", "third"):
        for fault in (None, *simulator.RUNS[run]):
            path.write_text("".join(f"{line}\n" for line in simulator.trace(run, fault, seed)))
            assert told(judged(run.__name__, path)) == plainly(run.__name__, path), (seed, fault)
