"""The sessions of a campaign: two monitors each, of which some wait for each other's events, and some do not."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from oracle_server.replay.opening import open_recording
from oracle_server.replay.report.lines import records as lines_of
from oracle_server.replay.run import Replay
from oracle_server.specfiles.load import parse_spec
from tests.chaos.link import Frame
from tests.chaos.runs import PAIR, TRIO, Layout, own, specs

DUO = Layout("two monitors, with what is derived", PAIR.monitors, TRIO.changes)
CROWD = """
id: crowd
streams:
  - {topic: /a, signals: {ok: msg.ok}}
  - {topic: /b, signals: {ok: msg.ok}}
properties:
  - {id: fine, formula: '{ok: true}'}
"""
"""Judged as it arrives, by each event alone: one monitor goes on while the other is at a server that stands."""


@dataclass(frozen=True)
class Work:
    """What one session is told: the events of each monitor, numbered."""

    session: str
    spec: str
    monitors: dict[str, list[Frame]]

    def attach(self, monitor: str) -> Frame:
        """The frame with which a monitor attaches."""
        return {
            "type": "attach", "monitor": monitor, "instance": f"process of {monitor}", "session": self.session,
            "spec": self.spec, "streams": sorted({event["stream"] for event in self.monitors[monitor]}),
        }  # fmt: skip


def works(trace: list[Frame], count: int) -> list[Work]:
    """So many sessions, of both kinds."""
    crowd = [
        {"type": "event", "stream": "/a" if i % 2 else "/b", "kind": "topic", "stamp": event["stamp"],
         "data": {"ok": i % 5 != 0}, "ask": i % 3 == 0}
        for i, event in enumerate(trace)
    ]  # fmt: skip
    apart = {name: own(trace, streams) for name, streams in DUO.monitors.items()}
    alone = {name: own(crowd, frozenset({f"/{name}"})) for name in "ab"}
    kinds = (("battery_uav", apart), ("crowd", alone))
    return [Work(f"s{i}", *kinds[i % 2]) for i in range(1, count + 1)]


def spec_folder(folder: Path) -> Path:
    """A folder with their specs."""
    found = specs(DUO, folder)
    (found / "crowd.yaml").write_text(CROWD)
    return found


def replayed(folder: Path, spec: str, trace: str) -> list[tuple[object, ...]]:
    """What the replay of a session's trace says of each of its verdicts."""
    path = folder / "trace.jsonl"
    path.write_text(trace, encoding="utf-8")
    judged_by = parse_spec((folder / "specs" / f"{spec}.yaml").read_text(), spec).spec
    replay = Replay(judged_by, open_recording(path, judged_by))
    return [said(record) for judged in replay for record in lines_of(replay, judged)]


def said(record: object) -> tuple[object, ...]:
    """What must be the same of a verdict however it was come to."""
    assert isinstance(record, dict)
    return tuple(record[key] for key in ("n", "step", "monitor", "seq", "property", "outcome", "violation"))
