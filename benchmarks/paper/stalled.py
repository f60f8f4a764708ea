"""Repeats the countdown under injected stalls, once for each way of judging, and keeps what the oracle has kept.

    source .build/ros2/setup.sh && python3 -m benchmarks.paper.stalled --runs 20 --keep .build/paper/stalls

In each run messages are held back ten times, for 200 to 600 ms, on their way to the monitor, and the percentages come
up to 50 ms late besides. Run n of every way has the stalls of seed n. Runs that are kept already are not made again;
one that fails is made again, three times at most. `benchmarks.paper.standing` says what was wrong in them.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

from benchmarks.paper.measure import JITTER, LATENT, spec_of
from benchmarks.paper.robot import REVISES, SERVER, Robot
from benchmarks.paper.stalls import LINKS, LONGEST

CALM, JUDGE = "judge, without stalls", "judge"
LONG_DELAY = round(LONGEST * 1000) + 100
LONG_LATENCY = round(LONGEST * 1000) + JITTER
_DELAY = "  max_delay: 200ms   # longer than the network delays a message; a light may change that much later\n"
_LATE = "  late: judge\n"
_LONG = (_DELAY, f"  max_delay: {LONG_DELAY}ms\n")
_PATIENT = tuple(
    (f"  - topic: /{topic} ", f"  - topic: /{topic}\n    latency: {LONG_LATENCY}ms   #")
    for topics in LINKS.values()
    for topic in topics
)
WAYS = {
    CALM: (LATENT,),
    JUDGE: (LATENT,),
    f"judge, max_delay {LONG_DELAY} ms": (LATENT, _LONG),
    f"judge, max_delay {LONG_DELAY} ms, latency {LONG_LATENCY} ms": (*_PATIENT, _LONG),
    "revise, horizon 2 s": (LATENT, (_LATE, f"  {REVISES}\n  horizon: 2s\n")),
}
"""How late events are met: what is changed in the spec. All but the first are under stalls."""
ATTEMPTS = 3
SECONDS = 16
"""How long a run takes, some."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--keep", type=Path, required=True)
    options = parser.parse_args()
    specs = {way: spec_of(changes) for way, changes in WAYS.items()}
    specs = {way: spec for way, spec in specs.items() if is_accepted(way, spec)}
    wanted = [(way, seed) for seed in range(1, options.runs + 1) for way in specs]
    missing = [(way, seed) for way, seed in wanted if not place(options.keep, way, seed).exists()]
    print(
        f"{len(missing)} runs of {len(wanted)} are to be made, some {len(missing) * SECONDS // 60 + 1} minutes",
        flush=True,
    )
    began = time.monotonic()
    try:
        for way, seed in missing:
            make(place(options.keep, way, seed), way, seed, specs[way])
    except KeyboardInterrupt:
        raise SystemExit("interrupted; the same command goes on with the runs that are missing") from None
    print(f"{len(missing)} runs took {(time.monotonic() - began) / 60:.1f} minutes", flush=True)


def place(keep: Path, way: str, seed: int) -> Path:
    return keep / way.replace(" ", "_").replace(",", "") / f"{seed:03}"


def is_accepted(way: str, spec: str) -> bool:
    """Whether this version of the server knows what a spec asks for."""
    with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
        file.write(spec)
        file.flush()
        checked = subprocess.run([SERVER, "check", file.name], capture_output=True, text=True, check=False)
    if checked.returncode:
        print(f"left out: {way}, whose spec is refused: {(checked.stdout + checked.stderr).strip()}", flush=True)
    return not checked.returncode


def make(target: Path, way: str, seed: int, spec: str) -> None:
    """Make a run, and keep it, whole or not at all."""
    for attempt in range(1, ATTEMPTS + 1):
        with tempfile.TemporaryDirectory(prefix="oracle-paper.") as folder:
            robot = Robot(Path(folder), spec, JITTER, 0 if way == CALM else seed)
            try:
                robot.fly()
            except (SystemExit, OSError) as problem:
                print(f"{way}, run {seed}, attempt {attempt}: {problem}", flush=True)
                continue
        keep(robot, target, way, seed, spec)
        return
    raise SystemExit(f"{way}, run {seed} failed {ATTEMPTS} times; what was made is kept, and the command goes on there")


def keep(robot: Robot, target: Path, way: str, seed: int, spec: str) -> None:
    assert robot.kept is not None
    new = target.with_suffix(".new")
    shutil.rmtree(new, ignore_errors=True)
    new.mkdir(parents=True)
    robot.kept.write(new)
    (new / "spec.yaml").write_text(spec)
    run = {"way": way, "run": seed, "calls": robot.calls, "stalls": robot.stalls, "load": os.getloadavg()[0]}
    (new / "run.json").write_text(json.dumps(run))
    new.rename(target)
    late = sum(any(p["late"] for p in line["places"]) for line in robot.kept.trace)
    held = sum(count for _, count in robot.stalls)
    print(f"{way}, run {seed}: {len(robot.kept.trace)} events, {held} held by {len(robot.stalls)} stalls, {late} late")


if __name__ == "__main__":
    main()
