"""A countdown in a bag, judged twice on either ROS: by the session that it is played to, and by `replay`."""

from __future__ import annotations

import json
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.flights import RATES, SPEED, Scene
from tests.processes import PATIENCE, ROOT, ROS_ONLY, SERVER, Data, Process, Server, environment

PATIENT = {
    "max_delay: 200ms": "max_delay: 5s",
    "action: log\n": "action: log\n    latency: 1s\n",
    "action: filter\n": "action: filter\n    decide_within: 10s\n",
}
"""What makes the battery UAV's spec one for any machine: this is not about what comes too late."""

Said = tuple[Any, ...]


def patient_spec(folder: Path) -> Path:
    """A folder with that spec."""
    text = (ROOT / "specs" / "battery_uav.yaml").read_text()
    for words, others in PATIENT.items():
        assert words in text
        text = text.replace(words, others)
    specs = folder / "specs"
    specs.mkdir()
    (specs / "battery_uav.yaml").write_text(text)
    return specs


def fly(scene: Scene, recorder: Process) -> int:
    """Fly a countdown with a wrong status while it is recorded; the recorder's exit status."""

    def start(module: str, **parameters: object) -> Process:
        return scene.node(module, rate=RATES[module] * SPEED, **parameters)

    panel = start("led_panel", wait_for=1)
    start("supervisor", wait_for=1, fault="wrong_status", service="/SetLED")
    panel.said("ready")
    start("battery", wait_for=2).wait()
    return recorder.end(signal.SIGINT)


def play_twice(adapter: Process, play: Callable[[], Process]) -> None:
    """Play a bag to an adapter, and again from its beginning, so that time goes back."""
    for _ in range(2):
        assert play().wait() == 0
    adapter.said(r"attached s\.run2")
    adapter.ends_well()


def lived(server: Server, session: str) -> list[Said]:
    """What was said live."""
    return [_said(record) for record in server.records(session)]


def replayed(specs: Path, bag: Path) -> list[Said]:
    """What the replay of a bag says; that there is a violation in it is made sure of."""
    ended = subprocess.run(
        [SERVER, "replay", specs / "battery_uav.yaml", bag, "--json"],
        capture_output=True, text=True, timeout=PATIENCE, env=environment(ROS_ONLY), check=False,
    )  # fmt: skip
    assert ended.returncode == 1, ended.stderr
    *records, last = map(json.loads, ended.stdout.splitlines())
    assert last["summary"]["properties"]["status_matches_percentage"]["violations"]
    return [_said(record) for record in records]


def _said(record: Data) -> Said:
    return tuple(record[name] for name in ("n", "step", "property", "outcome", "stream", "stamp", "skewed"))


def judged_alike(server: Server, specs: Path, bag: Path) -> bool:
    """Make sure that a bag was judged as it is replayed, both times that it was played.

    False where a machine under load kept messages back for longer than the spec's latency, so that some came late, or
    the last ones until their player was gone.
    """
    first, second = server.session("s"), server.session("s.run2")
    assert (first["clock"], first["continued_by"], second["clock"]) == ("sim", "s.run2", "sim")
    wanted = replayed(specs, bag)
    for session in ("s", "s.run2"):
        if any(event["late"] for event in server.events(session)):
            return False
        live = lived(server, session)
        for here, there in zip(live, wanted, strict=False):  # the first difference says more than all
            assert here == there
        if len(live) < len(wanted):
            return False
        assert len(live) == len(wanted)
    return True
