"""Rounds of sessions at three servers to which one thing after the other happens, and what must hold of them then."""

from __future__ import annotations

import asyncio
import itertools
import random
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import httpx

from tests.chaos.campaign import judged
from tests.chaos.fleet import Fleet
from tests.chaos.link import Frame, Link
from tests.chaos.pace import Pace
from tests.chaos.runs import assert_same, assert_sound, observed, uninterrupted
from tests.chaos.served import Served
from tests.fleet.cluster import NAMES, SPOILING, Cluster, Fault, name_of
from tests.fleet.rulings import Ruling, two_at_once
from tests.fleet.works import DUO, Work, replayed, said, spec_folder, works
from tests.postgres import Postgres
from tests.processes import PATIENCE

LIMIT = 20 * PATIENCE
NOT_JUDGED = "judged, and not when it was asked again"
JUDGED_LATER = "not judged, and judged when it was asked again"
FOR_NO_REASON = "judged, and again otherwise for no reason"
DEGRADED = "judged, and again behind something that was not"
_FINE = {True: "currently_true", False: "currently_false"}


@dataclass
class Way:
    """How one monitor comes to the fleet: at another server each time."""

    fleet: Fleet
    turns: Iterator[str]
    node: str = ""

    @property
    def up(self) -> asyncio.Event:
        return self.fleet.up

    @property
    def attach_url(self) -> str:
        self.node = next(self.turns)
        return self._server.attach_url

    @property
    def process(self) -> str:
        """The process at which its connection ends, while it has one."""
        return f"{self.node}.{self._server.pid}"

    @property
    def _server(self) -> Served:
        return self.fleet.nodes[self.node]


@dataclass
class Told:
    """A session's monitors, and who decided what they asked."""

    work: Work
    links: list[Link] = field(default_factory=list)
    rulings: list[Ruling] = field(default_factory=list)


@dataclass
class Count:
    """What was done; what must not be is asserted."""

    faults: Counter[str] = field(default_factory=Counter)
    acked: int = 0
    records: int = 0
    unknown: int = 0
    """Of these, those of what was asked while its server had no PostgreSQL: denied, and not judged."""
    otherwise: Counter[str] = field(default_factory=Counter)
    """Decisions that are not recorded as they were told first, by why: they were not committed, and made anew."""
    moves: int = 0
    """Sessions in which a second process decided, a third and so on."""


class Progress:
    """How much all monitors were told so far."""

    def __init__(self) -> None:
        self._seen = 0
        self._more = asyncio.Event()

    def note(self, count: int) -> None:
        self._seen += count
        self._more.set()

    async def reaches(self, count: float) -> None:
        while self._seen < count:
            self._more.clear()
            await self._more.wait()


async def run_round(
    postgres: Postgres, folder: Path, sessions: int, faults: Sequence[Fault], chance: random.Random,
    say: Callable[[str], object] = lambda line: None,
    events: int | None = None,
) -> Count:  # fmt: skip
    """Run sessions through a new fleet while faults happen one after the other, and assert what must hold.

    `events`: how many each session has at the most.
    """
    trace = observed(countdowns=1)[:events]
    expected = await uninterrupted(DUO, trace, folder, {})
    spoilt = not SPOILING.isdisjoint(faults)
    cluster = Cluster(postgres, spec_folder(folder), folder, chance, silences=spoilt)
    async with cluster:
        tolds = await _through(cluster, works(trace, sessions), trace, faults, chance, say)
        await cluster.whole()
        count = Count(Counter(map(name_of, faults)))
        for told in tolds:
            records = await _assert_right(cluster.fleet, told, folder, expected, spoilt)
            count.unknown += sum(record["outcome"] == "unknown" for record in records)
            count.records += len(records)
            count.acked += sum(link.acked for link in told.links)
            count.otherwise += _told_otherwise(told, records)
            count.moves += len({ruling.process for ruling in told.rulings}) - 1
        assert FOR_NO_REASON not in count.otherwise, count.otherwise
        for node in cluster.fleet.nodes.values():
            bugs = [line for line in node.log if "Traceback" in line["event"] or "exception" in line]
            assert not bugs, bugs[:3]
    return count


async def _through(
    cluster: Cluster, wanted: list[Work], trace: list[Frame], faults: Sequence[Fault], chance: random.Random,
    say: Callable[[str], object],
) -> list[Told]:  # fmt: skip
    """Send all, with a fault while each part of it is on its way."""
    stamps = [trace[len(trace) * part // (len(faults) + 1) - 1]["stamp"] for part in range(1, len(faults) + 2)]
    pace, progress, gate = Pace(stamps[0]), Progress(), asyncio.Event()
    tolds = [Told(work) for work in wanted]
    for number, told in enumerate(tolds):
        order = NAMES[number % 3 :] + NAMES[: number % 3]
        skips = not SPOILING.isdisjoint(faults)
        _add_links(told, cluster.fleet, order, pace, progress, gate, chance, skips=skips)
    cluster.links = links = [link for told in tolds for link in told.links]
    async with asyncio.timeout(LIMIT), asyncio.TaskGroup() as tasks:
        runs = [tasks.create_task(link.run()) for link in links]
        for link in links:
            await link.attached.wait()
        gate.set()
        before = 0
        for number, fault in enumerate(faults):
            upto = sum(1 + event["ask"] for link in links for event in link.events if event["stamp"] <= stamps[number])
            await progress.reaches(before + (upto - before) * chance.uniform(0.05, 0.7))
            begun = time.monotonic()
            await fault(cluster)
            say(f"{number + 1:4} {name_of(fault)}: {time.monotonic() - begun:.1f} s")
            pace.move_on(stamps[number + 1])
            before = upto
        try:
            for link in links:
                await link.done.wait()
        except asyncio.CancelledError:
            print(*(link for link in links if not link.done.is_set()), sep="\n")
            raise
        for run in runs:
            run.cancel()
    return tolds


def _add_links(
    told: Told, fleet: Fleet, order: str, pace: Pace, progress: Progress, gate: asyncio.Event, chance: random.Random,
    *, skips: bool,
) -> None:  # fmt: skip
    for monitor, events in told.work.monitors.items():
        way = Way(fleet, itertools.cycle(order))

        def decided(seq: int, asked: float, way: Way = way) -> None:
            told.rulings.append(Ruling(asked, time.monotonic(), way.process))

        end = max(event["stamp"] for each in told.work.monitors.values() for event in each) + 1
        told.links.append(
            Link(
                way,
                told.work.attach(monitor),
                events,
                end,
                chance,
                gate,
                progress.note,
                moves=True,
                skips=skips,
                pace=pace,
                pause=0.2,
                decided=decided,
            )
        )


def _excuse_unjudged(told: Told, records: list[Frame]) -> None:
    """What was decided, not committed, and asked again while nothing was judged, is `unknown`, whatever was told."""
    unjudged = {(r["monitor"], r["seq"]): r["decision"] for r in records if r["step"] is None}
    for link in told.links:
        for seq, frame in link.decisions.items():
            decision = unjudged.get((link.attach["monitor"], seq))
            if decision is not None:
                verdicts = dict.fromkeys(frame["verdicts"], "unknown")
                link.decisions[seq] = frame | {"decision": decision, "verdicts": verdicts}


def _told_otherwise(told: Told, records: list[Frame]) -> Counter[str]:
    kept = {(record["monitor"], record["seq"], record["property"]): record for record in records}
    found: Counter[str] = Counter()
    for link in told.links:
        for seq, frame in link.first.items():
            own = {name: kept[link.attach["monitor"], seq, name] for name in frame["verdicts"]}
            if any(r["outcome"] != frame["verdicts"][n] or r["decision"] != frame["decision"] for n, r in own.items()):
                found[_why_otherwise(frame, [*own.values()])] += 1
    return found


def _why_otherwise(frame: Frame, own: list[Frame]) -> str:
    if any(record["step"] is None for record in own):
        return NOT_JUDGED
    if set(frame["verdicts"].values()) == {"unknown"}:
        return JUDGED_LATER
    return DEGRADED if any(record["degraded"] for record in own) else FOR_NO_REASON


async def _assert_right(fleet: Fleet, told: Told, folder: Path, expected: list[Frame], spoilt: bool) -> list[Frame]:
    """What was acked is there, once, as it was told, as it is judged again, and no two servers decided at once."""
    session = told.work.session
    everywhere = await fleet.records(session)
    records = everywhere[0]
    assert all(told_there == records for told_there in everywhere), f"{session} is read differently"
    if spoilt:
        _excuse_unjudged(told, records)
    assert_sound(records, told.links)
    assert two_at_once(told.rulings) == [], session
    kept = {(record["monitor"], record["seq"], record["property"]): record for record in records}
    for link in told.links:
        for seq, decision in link.decisions.items():  # the last ones that came: a later one may have been lost
            own = {name: kept[link.attach["monitor"], seq, name] for name in decision["verdicts"]}
            same = all(record["outcome"] == decision["verdicts"][name] for name, record in own.items())
            excused = spoilt and _why_otherwise(decision, [*own.values()]) != FOR_NO_REASON
            assert same or excused, f"{session}: {seq} was told otherwise: {decision}, {own}"
    if told.work.spec == "crowd":
        data = {(name, event["seq"]): event["data"]["ok"] for name, own in told.work.monitors.items() for event in own}
        said_of = {key: kept[*key, "fine"]["outcome"] for key in data}
        wrong = {k: o for k, o in said_of.items() if o != _FINE[data[k]] and not (spoilt and o == "unknown")}
        assert not wrong, f"{session}: {wrong}"
    elif not spoilt:
        assert_same(records, expected)
    else:
        decided = {(link.attach["monitor"], s): f["decision"] for link in told.links for s, f in link.decisions.items()}
        count = judged(records, expected, decided, spoilt=True)
        assert not count.failures, f"{session}: {count}"
    node = next(iter(fleet.nodes.values()))
    async with httpx.AsyncClient(timeout=PATIENCE, trust_env=False) as http:
        trace = (await http.get(f"{node.url}/api/v1/sessions/{session}/trace")).raise_for_status().text
    judged_again = await asyncio.to_thread(replayed, folder, told.work.spec, trace)
    assert judged_again == [said(record) for record in records], f"the replay of {session} says something else"
    return records
