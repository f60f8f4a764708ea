"""Clocks of monitors that are not in step with the server's: what that does to its properties is told."""

from __future__ import annotations

from pathlib import Path

from oracle_server.history.memory import MemoryHistory
from oracle_server.sessions.status import session_state
from oracle_server.wire.incoming import ClockMessage, ClockStamp
from tests.sessions.making import Kept, Standing, attach, registry

SPEC = """
id: timed
streams:
  - {topic: /a, latency: 20ms}
properties:
  - {id: step, formula: '{topic: "/a"}'}
  - {id: alive, time: seconds, formula: 'once[:5s] {topic: "/a"}'}
"""
SECOND = 10**9
BEHIND = (
    "the clock of m is 1800 s behind the server's, or what it sends takes so long: "
    "deadlines run out before what meets them comes"
)
AHEAD = "the clock of m is 3 s ahead of the server's: its events are ordered as they arrive"


async def told(folder: Path, by: int, spec: str = SPEC) -> list[list[str]]:
    """The caveats of the properties of a session whose monitor's clock is ahead by so much (ns), one after another."""
    history, clock = MemoryHistory(), Standing()
    live, monitor = await registry(history, folder, spec, clock=clock).attach(attach("s", "timed"), Kept())
    stamp = clock.time + by - 20 * 10**6  # less the latency, as adapters do
    live.update_clocks(monitor, ClockMessage(type="clock", stamps=[ClockStamp(stream="/a", stamp=stamp)]))
    return [row["caveats"] for row in session_state(live, clock.time)["properties"]]


async def test_a_clock_that_is_behind_is_told_where_deadlines_go_by_it(tmp_path: Path) -> None:
    """They ran out at once, and each was a violation that had not happened."""
    assert await told(tmp_path, -1800 * SECOND) == [[], [BEHIND]]


async def test_a_clock_that_is_ahead_is_told(tmp_path: Path) -> None:
    assert await told(tmp_path, 3 * SECOND) == [[AHEAD], [AHEAD]]


async def test_nothing_is_told_of_clocks_that_may_differ_so_much(tmp_path: Path) -> None:
    assert await told(tmp_path, SECOND) == [[], []]
    assert await told(tmp_path, -SECOND) == [[], []]
    wide = SPEC.replace("streams:", "ordering: {max_skew: 1h}\nstreams:")
    assert await told(tmp_path, -1800 * SECOND, wide) == [[], []]


async def test_by_arrival_no_clock_matters(tmp_path: Path) -> None:
    by_both = SPEC.replace("streams:", "ordering: {by: both}\nstreams:")
    assert sorted(await told(tmp_path, -1800 * SECOND, by_both)) == [[], [], [], [BEHIND]]
