"""Many rounds of a trace through a server that is killed, and what became of the events: counted, not asserted.

Each round has several monitors in one session, ordered by publication. The points at which the server is killed are
counted in what monitors have been told, never in time.
"""

from __future__ import annotations

import asyncio
import random
from collections import Counter
from collections.abc import Callable
from contextlib import nullcontext, suppress
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path

from tests.chaos.disk import Disk, small_disk
from tests.chaos.link import Frame
from tests.chaos.robots import Robot
from tests.chaos.runs import (
    LATE,
    LIMIT,
    PASSING,
    SESSION,
    TRIO,
    Layout,
    attach_frame,
    key,
    own,
    specs,
    stream_through,
    told,
    void,
)
from tests.chaos.served import Ended, Served, reviving

_DIES_WHILE_RESTORING = """
import os, random, signal
from oracle_server.core.session import Session
rejudge = Session.rejudge
def perhaps(*arguments):
    if random.random() < 0.0005:
        os.kill(os.getpid(), signal.SIGKILL)
    return rejudge(*arguments)
Session.rejudge = perhaps
"""
_COMMITS_SLOWLY = """
import random, time
from oracle_server.history.sql.writer import Writer
write = Writer._write
def slowly(self, batch):
    time.sleep(random.uniform(0, 0.05))
    result = write(self, batch)
    time.sleep(random.uniform(0, 0.05))
    return result
Writer._write = slowly
"""
_DIES_WHILE_RESTORING_WHAT_REVISES = """
import os, random, signal
from oracle_server.core.session import Session
rejudge = Session.rejudge_row
def perhaps(*arguments):
    if random.random() < 0.0002:
        os.kill(os.getpid(), signal.SIGKILL)
    return rejudge(*arguments)
Session.rejudge_row = perhaps
"""
_STANDING = ("stream", "kind", "stamp", "violation", "degraded", "skewed")
"""What stands of a record whatever came late; beside its outcome, which is final or not."""
_NOT_WRITTEN, _WRITTEN = "the history can't be written", "the history can be written again"


@dataclass(frozen=True)
class Kind:
    """A kind of round: what else happens besides the kills."""

    name: str
    prelude: str = ""
    robots: bool = False
    full: bool = False
    revises: bool = False
    """Whether events come late, and what is compared is what stands."""


KINDS = (
    Kind("killed"),
    Kind("with the adapters' link", robots=True),
    Kind("killed while it restores", prelude=_DIES_WHILE_RESTORING),
    Kind("on a slow disk", prelude=_COMMITS_SLOWLY),
    Kind("on a disk that is full for a while", full=True),
    Kind("with late events that revise", prelude=_DIES_WHILE_RESTORING_WHAT_REVISES, revises=True),
)


@dataclass
class Count:
    """What became of the events of some rounds; all but the first three are to be 0."""

    kills: int = 0
    acked: int = 0
    """Events; each makes a record a property."""
    late: int = 0
    """Records of events that were put in their places."""
    lost: int = 0
    """Records that are not there though their events were acked."""
    twice: int = 0
    """Records, decisions and answers that are there more than once, or not in the order of their numbers."""
    different: int = 0
    """Records that say something else than those of a run without interruption, and decisions that they do not say."""

    def __add__(self, other: Count) -> Count:
        return Count(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    @property
    def failures(self) -> int:
        """What must not be."""
        return self.lost + self.twice + self.different


class Mortal(Served):
    """A server whose processes may end by themselves while they start."""

    async def start(self) -> None:
        """Start processes until one accepts work; where none of a hundred does, something else is wrong."""
        for _ in range(99):
            with suppress(Ended):
                await super().start()
                return
        await super().start()


async def run_round(
    kind: Kind, trace: list[Frame], expected: list[Frame], folder: Path, chance: random.Random, kills: int
) -> Count:
    """One round with at least so many kills, in an empty folder; raises `Unmountable` where it needs a disk."""
    with small_disk(folder / "disk") if kind.full else nullcontext() as disk:
        data = disk.folder / "data" if disk else folder / "data"
        layout = LATE if kind.revises else TRIO
        async with Mortal(specs(layout, folder), data, prelude=kind.prelude, resume_within="600") as served:
            async with reviving(served):
                async with asyncio.TaskGroup() as tasks:
                    over = tasks.create_task(asyncio.Event().wait())
                    strike = _strike(served, disk, tasks, over, chance)
                    run = _with_robots if kind.robots else partial(_by_wire, skips=kind.full)
                    decisions, again = await run(served, layout, trace, chance, kills, strike)
                    over.cancel()
                await served.up.wait()
            count = Count(served.starts - 1, len(trace), twice=again)
            records = await served.records(SESSION)
            count.late = sum("place" in record for record in records)
            await served.stop()
            await served.start()
            count.different += records != await served.records(SESSION)
    return count + judged(records, expected, decisions, spoilt=kind.full, revised=kind.revises)


def judged(
    records: list[Frame],
    expected: list[Frame],
    decisions: dict[tuple[str, int], str],
    *,
    spoilt: bool,
    revised: bool = False,
) -> Count:
    """What became of a round's events, by its records; `spoilt`: what was skipped for want of space is said to be.

    `revised`: revisions have numbers of their own, and what stands is compared.
    """
    found = Counter(map(key, records))
    wanted = {key(record): record for record in expected}
    count = Count(lost=len(wanted.keys() - found.keys()), twice=sum(n - 1 for n in found.values()))
    numbers = [record["n"] for record in records]
    count.twice += numbers != (sorted(set(numbers)) if revised else list(range(1, len(records) + 1)))
    said = _standing if revised else partial(_said, spoilt=spoilt)
    for record in records:
        other = wanted.get(key(record))
        excused = spoilt and (record["outcome"] == "unknown" or record["degraded"])
        count.different += other is None or not (excused or said(record) == said(other))
        told_as = decisions.get((record["monitor"], record["seq"]))
        is_last = other is None or other["decision"] is not None  # an event is decided on with the last of its rows
        count.different += told_as is not None and record["decision"] != (told_as if is_last else None)
    return count


def _said(record: Frame, spoilt: bool) -> Frame:
    passing = PASSING | {"n", "step", "explanation"} if spoilt else PASSING
    return {name: value for name, value in record.items() if name not in passing}


def _standing(record: Frame) -> Frame:
    outcome = record["outcome"].removeprefix("currently_")
    return {name: record[name] for name in _STANDING} | {"outcome": outcome}


def _strike(
    served: Served, disk: Disk | None, tasks: asyncio.TaskGroup, over: asyncio.Task[object], chance: random.Random
) -> Callable[[], None]:
    """What strikes the server; once all is `over`, and nothing left to write, no full disk is noticed any more."""
    if disk is None:
        return served.kill
    one_by_one, fulls = asyncio.Lock(), 0

    async def be_full() -> None:
        nonlocal fulls
        async with one_by_one:
            await served.up.wait()
            disk.fill()
            fulls += 1
            noticed = tasks.create_task(served.said(_NOT_WRITTEN, fulls))
            await asyncio.wait((noticed, over), return_when=asyncio.FIRST_COMPLETED)
            if not noticed.done():
                noticed.cancel()
                disk.free()
                return
            if chance.random() < 0.5:
                served.kill()
                disk.free()
            else:
                disk.free()
                await served.said(_WRITTEN, served.count(_WRITTEN) + 1)
                served.kill()

    return lambda: void(tasks.create_task(be_full()))


async def _by_wire(
    served: Served,
    layout: Layout,
    trace: list[Frame],
    chance: random.Random,
    kills: int,
    strike: Callable[[], None],
    *,
    skips: bool,
) -> tuple[dict[tuple[str, int], str], int]:
    points = _points(told(trace), chance, kills)
    links = await stream_through(served, layout, trace, chance, points, lambda _: strike(), skips=skips)
    return {(link.attach["monitor"], s): f["decision"] for link in links for s, f in link.decisions.items()}, 0


async def _with_robots(
    served: Served, layout: Layout, trace: list[Frame], chance: random.Random, kills: int, strike: Callable[[], None]
) -> tuple[dict[tuple[str, int], str], int]:
    left, seen = _points(len(trace), chance, kills), 0

    def moved(count: int) -> None:
        nonlocal seen
        seen += count
        if left and seen >= left[0] and served.up.is_set():
            del left[0]
            strike()

    robots = [
        Robot(served, attach_frame(layout, monitor), own(trace, names), trace[-1]["stamp"] + 1, moved)
        for monitor, names in layout.monitors.items()
    ]
    async with asyncio.timeout(LIMIT):
        await asyncio.gather(*(robot.run() for robot in robots))
    wrong = sum(robot.answered[e["seq"]] != 1 for robot in robots for e in robot.events if e["ask"])
    return {}, wrong


def _points(count: int, chance: random.Random, kills: int) -> list[int]:
    return sorted(chance.sample(range(count // 20, count * 2 // 3), kills))
