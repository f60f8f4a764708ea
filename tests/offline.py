"""Monitors without an oracle on either ROS: a log, and what `replay` says of it."""

from __future__ import annotations

import json
import signal
import sys
from pathlib import Path
from typing import Protocol

from tests.processes import ROOT, SERVER, Data, Process, eventually

SPEC = ROOT / "specs" / "battery_uav.yaml"


class Scene(Protocol):
    """A ROS graph to which a test adds processes."""

    def run(self, name: str, *command: object) -> Process: ...


def logging(scene: Scene, package: str, log: Path) -> Process:
    """An adapter that writes the streams of the battery UAV's spec to a log, and observes."""
    made = scene.run("streams", SERVER, "streams", SPEC)
    assert made.wait() == 0
    streams = log.with_name("streams.json")
    streams.write_text(made.log)
    words = ("--log", log, "--streams", streams, "--monitor", "uav1")
    adapter = scene.run("adapter", sys.executable, "-m", package, *words)
    adapter.said("observing")
    return adapter


def logged(adapter: Process, log: Path, count: int) -> list[Data]:
    """End an adapter once it has logged so many events; what it has logged."""
    eventually(lambda: len(log.read_text().splitlines()), lambda found: found >= count)
    assert adapter.end(signal.SIGINT) == 0
    return [json.loads(line) for line in log.read_text().splitlines()]


def replayed(scene: Scene, log: Path) -> Process:
    """What `replay` says of a log."""
    return scene.run("replay", SERVER, "replay", SPEC, log)
