"""Sessions of monitors that say what they should and what they should not, and what must hold of them all the same."""

from __future__ import annotations

import asyncio
import json
import random
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from functools import cache
from pathlib import Path

import httpx

from oracle_server.specfiles.load import load_spec
from tests.chaos.served import PATIENCE, Served
from tests.fuzz.bystander import Bystander
from tests.fuzz.frames import Frame, Writer
from tests.fuzz.monitor import Monitor, Told

_TESTS = Path(__file__).parents[1]
FOLDERS = (_TESTS / "whole" / "specs", _TESTS / "vectors" / "specs", _TESTS / "fuzz" / "specs")
SPECS = (
    "pair", "single", "both", "deadline", "timed", "texts", "remembers", "tiny", "presence", "lamp", "bypassed",
    "errand", "answered", "strict", "explained", "prompt", "reelay", "robust", "booted",
)  # fmt: skip
AMENDED = frozenset({"passed", "kind"})
"""What a record says that may change after its commit: what the adapter did."""
AT_ONCE = 3
"""Sessions at a time."""
LONGEST = 10_000
"""Characters of a line of the log, whatever robots say: it is for people."""
LONG = 200
"""Frames of a session, on average."""


@dataclass
class Count:
    """What became of some sessions; `wrong` is to be empty."""

    frames: int = 0
    judged: int = 0
    """Frames that held an event which is in the history by it."""
    events: int = 0
    """Events in the history."""
    asked: int = 0
    """What the bystander asked."""
    wrong: list[str] = field(default_factory=list)

    def __add__(self, other: Count) -> Count:
        return Count(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))


def prepare(folder: Path) -> Path:
    """A folder with the specs, which are read here: while anybody is attached it would delay the answers to pings."""
    folder.mkdir()
    for name in SPECS:
        _keys(name)
        (source,) = (path for known in FOLDERS for path in known.glob(f"{name}.yaml"))
        (folder / source.name).write_text(source.read_text())
    return folder


async def leg(served: Served, number: int, frames: int, seed: int) -> Count:
    """About so many frames beside one bystander; the server goes on."""
    bystander = Bystander(served, f"bystander{number}")
    total = Count()
    async with asyncio.TaskGroup() as tasks:
        watching = tasks.create_task(_alive(served))
        beside = tasks.create_task(bystander.run())
        turn = 0
        while total.frames < frames:
            rounds = [
                tasks.create_task(_round(served, f"f{number}.{turn + i}", seed, bystander.frame))
                for i in range(AT_ONCE)
            ]
            turn += AT_ONCE
            total = sum([await one for one in rounds], total)
        bystander.end()
        await beside
        watching.cancel()
    await bystander.check()
    total.asked += bystander.asked
    total.wrong += bystander.wrong
    total.wrong += _failures(served)
    return total


async def _alive(served: Served) -> None:
    """Fail where the server ends."""
    status = await served.ended()
    raise AssertionError(f"the server ended with {status}: {served.log[-20:]}")


def _failures(served: Served) -> list[str]:
    """The lines of the log that tell of a bug: errors, and what is no line of a log."""
    usual = ("info", "warning", "debug")
    found = [line for line in served.log if line.get("level") not in usual or "Traceback" in str(line)]
    endless = [line for line in served.log if len(str(line)) > LONGEST]
    return [f"the server said {str(line)[:LONGEST]}" for line in found + endless]


@dataclass
class Talk:
    """The monitors of one session, what they were told, and the spec that it is judged by."""

    session: str
    spec: str
    monitors: list[Monitor]
    told: Told
    chance: random.Random

    async def run(self) -> None:
        """Have all monitors speak, until what they said is committed."""
        share = LONG * 2 // len(self.monitors)
        async with asyncio.TaskGroup() as tasks:
            for monitor in self.monitors:
                tasks.create_task(monitor.run(self.chance.randint(share // 4, share)))

    def count(self, records: list[Frame], streamed: list[Frame]) -> Count:
        """What became of it, by the records of its history, and those that were streamed."""
        wrong = [*self.told.wrong, *wrong_with(records, streamed, self.monitors, self.told)]
        count = Count(sum(len(monitor.frames) for monitor in self.monitors))
        count.wrong = [f"{self.session} ({self.spec}): {what}" for what in wrong]
        judged = {(r["monitor"], r["seq"]) for r in records if r["kind"] != "tick"}
        count.events = len(judged)
        for monitor in self.monitors:
            left = {seq for name, seq in judged if name == monitor.name}
            for frame in monitor.frames:
                own = {event.seq for event in frame.events} & left
                count.judged += bool(own)
                left -= own
        return count


def _talk(served: Served, session: str, seed: int, sending: Callable[[], None]) -> Talk:
    chance = random.Random(f"{seed} {session}")
    spec = chance.choice(SPECS)
    clock, told = chance.choice(("wall", "wall", "wall", "sim")), Told()
    monitors = []
    for i in range(chance.choice((1, 2, 2, 3))):
        writer = Writer(random.Random(chance.random()), _keys(spec))
        monitors.append(Monitor(served.attach_url, f"m{i + 1}", session, spec, clock, writer, told, sending))
    return Talk(session, spec, monitors, told, chance)


async def _round(served: Served, session: str, seed: int, sending: Callable[[], None]) -> Count:
    """One session from its first frame to its end."""
    talk = _talk(served, session, seed, sending)
    async with asyncio.TaskGroup() as tasks:
        reading = tasks.create_task(_streamed(served, session, talk.monitors[0]))
        await talk.run()
        await _close(served, talk)
        streamed = await reading
    return talk.count(await served.records(session), streamed)


async def restarted(served: Served, seed: int) -> Count:
    """Some sessions over a restart of the server: what was committed stays, and they can be closed as any other."""
    talks = [_talk(served, f"r{i}", seed, lambda: None) for i in range(AT_ONCE)]
    await asyncio.gather(*(talk.run() for talk in talks))
    before = {talk.session: await served.records(talk.session) for talk in talks}
    if random.Random(seed).random() < 0.5:
        served.kill()
    else:
        assert await served.stop() == 0
    await served.start()
    total = Count()
    for talk in talks:
        await _close(served, talk)
        records = await served.records(talk.session)
        if [_lasting(r) for r in records[: len(before[talk.session])]] != [_lasting(r) for r in before[talk.session]]:
            talk.told.wrong.append("its records are others after the restart")
        total += talk.count(records, records)
    total.wrong += _failures(served)
    return total


async def _close(served: Served, talk: Talk) -> None:
    async with _http(served) as http:
        closed = await http.delete(f"sessions/{talk.session}")
    if closed.status_code != 200:
        talk.told.wrong.append(f"closing it was answered by {closed.text}")


def wrong_with(records: list[Frame], streamed: list[Frame], monitors: list[Monitor], told: Told) -> list[str]:
    """What does not hold of a session that has ended."""
    wrong = []
    if [r["n"] for r in records] != list(range(1, len(records) + 1)):
        wrong.append("its numbers have gaps")
    if [_lasting(r) for r in records] != [_lasting(r) for r in streamed]:
        wrong.append(f"its stream had {len(streamed)} records that are not the {len(records)} of its history")
    known = {r["n"]: r for r in records}
    for n, frame in told.violations.items():
        if _lasting(frame) != _lasting(known.get(n, {})):
            wrong.append(f"{frame} was pushed, and the history has {known.get(n)}")
    found = defaultdict[tuple[str, int], list[Frame]](list)
    for record in records:
        if record["kind"] != "tick":
            found[record["monitor"], record["seq"]].append(record)
    for (name, seq), frame in told.decisions.items():
        said = {r["property"]: (r["decision"], r["outcome"]) for r in found[name, seq] if r["decision"]}
        if said != {p: (frame["decision"], outcome) for p, outcome in frame["verdicts"].items()}:
            wrong.append(f"{frame} was told to {name}, and the history has {said}")
    width = len({(r["property"], r["order"]) for r in records if r["kind"] != "tick"})
    for monitor in monitors:
        wrong += _wrong_of(monitor, {seq: own for (name, seq), own in found.items() if name == monitor.name}, width)
    return wrong


def _wrong_of(monitor: Monitor, found: dict[int, list[Frame]], width: int) -> list[str]:
    """What does not hold of one monitor's events, whose records are given by their numbers; `width` of each."""
    missing = sorted(monitor.numbers.must_be_judged() - found.keys())
    wrong = [f"{monitor.name}'s {seq} was acked, and is not there: {monitor.numbers.sent[seq]}" for seq in missing]
    for seq, records in found.items():
        sent = monitor.numbers.sent.get(seq, [])
        if not sent:
            wrong.append(f"{monitor.name} never sent {seq}")
        if len(records) != width or set(Counter((r["property"], r["order"]) for r in records).values()) != {1}:
            wrong.append(f"{monitor.name}'s {seq} is there {len(records)} times, and not {width}")
        if seq in monitor.numbers.refused and len(sent) == 1:
            wrong.append(f"{monitor.name}'s {seq} was refused, and judged: {sent}")
        if records[0]["stream"] not in {event.stream for event in sent}:
            wrong.append(f"{monitor.name}'s {seq} is there of {records[0]['stream']}: {sent}")
    return wrong


def _lasting(record: Frame) -> Frame:
    return {name: value for name, value in record.items() if name not in AMENDED | {"type"}}


async def _streamed(served: Served, session: str, monitor: Monitor) -> list[Frame]:
    """All that is streamed of a session, from when its first monitor has attached until it is closed."""
    async with asyncio.timeout(PATIENCE):
        await monitor.attached.wait()
    found, rest = [], b""
    async with _http(served) as http, http.stream("GET", f"sessions/{session}/stream") as answer:
        async for chunk in answer.aiter_bytes():  # lines of texts would end at more than newlines
            *lines, rest = (rest + chunk).split(b"\n")
            found += [json.loads(line[6:]) for line in lines if line.startswith(b'data: {"')]
    return found


def _http(served: Served) -> httpx.AsyncClient:
    return httpx.AsyncClient(base_url=f"{served.url}/api/v1/", timeout=PATIENCE, trust_env=False)


@cache
def _keys(spec: str) -> list[tuple[str, str]]:
    (path,) = (path for known in FOLDERS for path in known.glob(f"{spec}.yaml"))
    return [(key.name, str(key.kind)) for key in load_spec(path).spec.by_key]
