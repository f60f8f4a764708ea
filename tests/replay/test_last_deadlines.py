"""A session's own trace that ends with deadlines tells of them in any other order, too."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from oracle_server.core.events import By, Event, Order
from oracle_server.core.ordering.simulated import ClockReading
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.spec import Spec
from oracle_server.core.verdicts import Judged, Outcome
from oracle_server.engines.table import make_engines
from oracle_server.foxglove.file import Beside, write_mcap
from oracle_server.history.records import StoredStep
from oracle_server.replay.opening import open_recording
from oracle_server.replay.run import Replay
from oracle_server.review.trace import event_line
from oracle_server.specfiles.load import load_spec
from tests.replay.judging import BASE, MS, write_spec

SPEC = """
id: dog
ordering: {{by: {by}, max_delay: {wait}}}
streams: [{{topic: /field, signals: {{occupied: msg.data}}, ordered: {ordered}}}]
properties:
  - {{id: lives, pattern: '/field every 500ms'}}
  - {{id: soon, pattern: '/field every 700ms'}}
  - {{id: later, pattern: '/field every 2s'}}
"""
ORDERS: list[By] = ["publication", "arrival", "both"]


class Live:
    """A session that hears of a field for a second, and then of nothing; what it judged, as its trace has it.

    Events arrive `behind` ms after their stamps. In a simulation, the server's time is another one, and the clock
    tells the time; else it tells nothing, or where `clocked` that of each 100 ms.
    """

    def __init__(self, spec: Spec, behind: float, *, clocked: bool = False, server: int | None = None) -> None:
        ready = plan(spec)
        self.session = Session(ready, make_engines(ready))
        self.judged: list[Judged] = []
        self._spec, self._server = spec, server
        if server is not None:
            self.session.simulate()
        self.judged += self.session.attach("m", spec.by_key, self._now(0))
        (key,) = spec.by_key
        for n in range(1, 24):
            at = n * 100 * MS
            if clocked or server is not None:
                readings = [ClockReading(key, BASE + at - 20 * MS)]
                self.judged += self.session.clock("m", readings, self._now(at))
            if n <= 10:
                arrived = at + int(behind * MS)
                event = Event(key, "m", n, BASE + at, self._now(arrived), {"data": False})
                self.judged += self.session.ingest(event)
            self._wait(self._now(at + 50 * MS))

    def _now(self, at: int) -> int:
        return (BASE if self._server is None else self._server) + at

    def _wait(self, until: int) -> None:
        while (due := self.session.next_deadline) is not None and due <= until:
            self.judged += self.session.advance(due)

    def lines(self) -> Iterator[bytes]:
        lines: dict[Any, Any] = {}
        for position, judged in enumerate(self.judged, 1):
            event, is_tick = judged.step.event, not judged.step.event.monitor
            step = msgspec.structs.replace(judged.step, event=msgspec.structs.replace(event, received=None))
            stored = StoredStep(position, judged.order, position, step, 0, judged.judged, None, (), (), {})
            place = {"position": position, "order": judged.order, "judged": judged.judged}
            line = lines.setdefault((is_tick, is_tick and position, event.seq), event_line(stored))
            line["places"].append(place)
        for n, line in enumerate(sorted(lines.values(), key=lambda line: line["places"][0]["position"])):
            yield msgspec.json.encode(line | ({} if n else {"begun": self.session.begun}))


def violated(session: Session | None) -> set[tuple[Order, str]]:
    assert session is not None
    judges = session.judges.items()
    return {(order, state.property.id) for order, judge in judges for state in judge.properties if state.violations}


def replayed(path: Path, spec: Spec, by: By) -> tuple[Replay, list[Judged]]:
    replay = Replay(spec, open_recording(path, spec), by)
    return replay, list(replay)


def spec_of(folder: Path, by: By, wait: str = "200ms", ordered: str = "true") -> Spec:
    return load_spec(write_spec(folder, SPEC.format(by=by, wait=wait, ordered=ordered))).spec


HOW: dict[str, tuple[dict[str, Any], dict[str, str]]] = {
    "plain": ({}, {}),
    "clocked": ({"clocked": True}, {}),
    "waiting for every stream": ({"clocked": True}, {"wait": "none"}),
    "without order": ({}, {"ordered": "false"}),
    "in a simulation of the past": ({"server": BASE + 10**18}, {}),
    "in a simulation of the future": ({"server": BASE - 10**18}, {}),
}


@pytest.mark.parametrize("how", HOW)
@pytest.mark.parametrize("behind", [-1.5, 0.3, 15])
@pytest.mark.parametrize("by", ORDERS)
def test_the_last_deadlines_are_judged_in_each_order(by: By, behind: float, how: str, tmp_path: Path) -> None:
    """The last ones are violated in every order, and those that were still open live are in none."""
    running, words = HOW[how]
    spec = spec_of(tmp_path, by, **words)
    live = Live(spec, behind, **running)
    assert {name for _, name in violated(live.session)} == {"lives", "soon"}
    assert b'"tick"' in [*live.lines()][-1]
    path = tmp_path / ("own.mcap" if how == "clocked" else "own.jsonl")
    if how == "clocked":
        write_mcap(path, live.lines(), Beside(list, list))
    else:
        path.write_bytes(b"".join(line + b"\n" for line in live.lines()))
    for again in ORDERS:
        replay, judged = replayed(path, spec, again)
        orders = ("publication", "arrival") if again == "both" else (again,)
        assert violated(replay.session) == {(order, name) for order in orders for name in ("lives", "soon")}, again
        assert all(verdict.outcome is not Outcome.UNKNOWN for row in judged for verdict in row.verdicts)
