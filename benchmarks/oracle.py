"""How fast the oracle decides and how much it judges, each beside a bare baseline measured in the same run.

    python benchmarks/oracle.py [--json] [--quick]

*Round trip*: one ask at a time over one connection, against an echo over the same stack in a process of its own. Who
asks keeps to one core and both servers to others: else the system puts it with the one and apart from the other. The
same by a UNIX socket is compared with the oracle by TCP.
*Throughput*: from the first event until the ack of the last one, against one loop without any server that decodes the
same frames, computes the same signals, steps the same engines and inserts the same rows, 256 to a commit. Each is
measured three times, in turns, and the best counts: whatever else the machine does only slows.
*CPU*: what both spend on an event, which the rest of the machine hardly changes.
*late: revise*: the CPU of the server for the same events by the same spec with `late: revise`, none of them late,
against the server without: two servers take some hundred events each in turns, and the median ratio of these pairs
counts, since whatever else the machine does lasts longer than one. `revising.py` has what it costs in the judge alone.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import sqlite3
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import count
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import msgspec
from apart import Server, apart, echo, oracle
from lines import Line, table
from websockets.asyncio.client import ClientConnection, connect, unix_connect

from oracle_server.core.events import Event, Step, StreamKey
from oracle_server.core.judging.judge import Judge
from oracle_server.core.plan import Plan, plan
from oracle_server.core.spec import orders
from oracle_server.engines.table import make_engines
from oracle_server.history.records import stored
from oracle_server.history.sql.rows import Row, step_row
from oracle_server.history.sql.schema import DDL, STEP_COLUMNS
from oracle_server.specfiles.load import parse_spec

ROOT = Path(__file__).resolve().parents[1]
PATIENCE = 60.0
COMMIT = 256
"""Events to a commit of the bare loop."""
BLOCK = 512
"""Events of a turn, where two servers take turns."""

# The first property of specs/battery_uav.yaml with its three streams in one: a status reports on a percentage that was
# accepted, and reports its class. One stream waits for no other, so nothing here depends on `max_delay`.
ONE_STREAM = """
id: one_stream
ordering: {by: publication, max_delay: 200ms}
streams:
  - topic: /battery_status
    signals:
      id: string(msg.id)
      accepted: string(msg.accepted)
      status: "msg.status >= 0 && msg.status <= 3 ? string(msg.status) : 'INVALID'"
      percentage: >-
        msg.percentage > 40.0 && msg.percentage <= 100.0 ? '1' :
        msg.percentage > 30.0 && msg.percentage <= 40.0 ? '2' :
        msg.percentage >= 0.0 && msg.percentage <= 30.0 ? '3' : 'INVALID'
properties:
  - id: status_matches_percentage
    formula: |
      forall[i, s]. {topic: "/battery_status", id: *i, status: *s} ->
        once{topic: "/battery_status", accepted: *i} and
        once{topic: "/battery_status", id: *i, percentage: *s}
"""

Frame = dict[str, Any]


@dataclass(frozen=True)
class Load:
    """A spec, and events for it."""

    name: str
    spec: str
    text: str
    events: list[Frame]

    def frames(self, size: int, start: int = 0, end: int | None = None) -> list[str]:
        """The events from `start` on in batches, each followed by the clock where there is more than one stream."""
        events, streams = self.events[start:end], sorted({(each["stream"], each["kind"]) for each in self.events})
        frames = []
        for at in range(0, len(events), size):
            batch = events[at : at + size]
            frames.append(_encode(batch[0] if size == 1 else {"type": "events", "events": batch}))
            if len(streams) > 1:
                stamps = [{"stream": name, "kind": kind, "stamp": batch[-1]["stamp"]} for name, kind in streams]
                frames.append(_encode({"type": "clock", "stamps": stamps}))
        return frames


class Speed(NamedTuple):
    """Events a second, and CPU seconds an event."""

    rate: float
    cpu: float


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description="Measure the oracle server beside bare baselines.")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.add_argument("--quick", action="store_true", help="measure little: to see that it runs")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        lines = asyncio.run(measure(Path(folder), quick=args.quick))
    if args.json:
        print(json.dumps([asdict(line) | {"ratio": line.ratio, "met": line.met} for line in lines], indent=2))
    else:
        print(table(lines))


async def measure(folder: Path, *, quick: bool) -> list[Line]:
    """All lines of the table."""
    specs = folder / "specs"
    specs.mkdir()
    battery = (ROOT / "specs" / "battery_uav.yaml").read_text()
    (specs / "one_stream.yaml").write_text(ONE_STREAM)
    (specs / "battery_uav.yaml").write_text(battery)
    revising = battery.replace("late: judge", "late: revise").replace("id: battery_uav", "id: revising", 1)
    (specs / "revising.yaml").write_text(revising)
    few, many, turns = (300, 800, 1) if quick else (3_000, 8_000, 3)
    small = Load("1 property", "one_stream", ONE_STREAM, statuses(few))
    large = Load("1 property", "one_stream", ONE_STREAM, statuses(many))
    whole = Load("battery_uav, 6 properties", "battery_uav", battery, battery_events(many))
    socket = folder / "oracle.sock"
    with oracle(specs, folder / "data", socket) as server, echo() as other:
        with apart(server.pid, other.pid):
            lines = await round_trips(server.url, other.url, socket, small.events)
        for load, size in ((small, 1), (large, 16), (large, 256), (whole, 256)):
            served, bare = [], []
            for turn in range(turns):
                name = f"{load.spec}-{size}-{turn}"
                served.append(await throughput(server, load, size, name))
                bare.append(bare_throughput(load, size, folder / f"{name}.sqlite"))
            best, bare_best = max(speed.rate for speed in served), max(speed.rate for speed in bare)
            what = f"batches of {size}: {load.name}"
            lines.append(Line(what, "events/s", best, bare_best, {1: 0.6, 256: 0.75}.get(size)))
            if size == 256 and Path("/proc/self/stat").exists():
                least, bare_least = min(speed.cpu for speed in served), min(speed.cpu for speed in bare)
                lines.append(Line("  CPU an event", "µs", 1e6 * least, 1e6 * bare_least))
    same = Load("the same", "revising", revising, whole.events)
    for size in (1, 256):
        lines += await by_revising(folder, specs, (whole, same), size, turns)
    return lines


async def by_revising(folder: Path, specs: Path, loads: tuple[Load, Load], size: int, rounds: int) -> list[Line]:
    """What a server spends on an event with the second spec, which revises, beside one with the first, which does not.

    Each has a server of its own: two sessions of one would wait for each other. None where no system tells.
    """
    pairs: list[list[float]] = []
    with oracle(specs, folder / f"plain-{size}") as plain, oracle(specs, folder / f"revising-{size}") as revising:
        for turn in range(rounds):
            async with dial(plain.url) as without, dial(revising.url) as beside:
                each = [(plain, without, loads[0]), (revising, beside, loads[1])]
                for _, peer, load in each:
                    await attach(peer, load.spec, f"in-turns-{turn}")
                for start in range(0, len(loads[0].events), BLOCK):
                    end = min(start + BLOCK, len(loads[0].events))
                    pairs.append([await spent(server, peer, load, size, start, end) for server, peer, load in each])
    typical, goal = median(pair[0] for pair in pairs), 1.05 if size == 1 else None
    ratio = median(pair[1] / max(pair[0], 1e-9) for pair in pairs)
    what = f"late: revise, batches of {size}: CPU"
    return [Line(what, "µs", 1e6 * typical * ratio, 1e6 * typical, goal)] if typical else []


async def spent(server: Server, peer: ClientConnection, load: Load, size: int, start: int, end: int) -> float:
    """The CPU seconds that a server spends on each of some events, which are numbered from 1 on."""
    frames, before = load.frames(size, start, end), server.cpu
    async with asyncio.timeout(PATIENCE):
        await tell(peer, frames, end)
    used: float = server.cpu - before
    return used / (end - start)


async def round_trips(oracle_url: str, echo_url: str, path: Path, events: list[Frame]) -> list[Line]:
    """Times from sending an ask to having its decision, and from sending the same frame to having it back."""
    asks = [_encode(event | {"ask": True}) for event in events]
    decided: list[int] = []
    by_path: list[int] = []
    echoed: list[int] = []
    async with (
        dial(oracle_url) as monitor,
        unix_connect(str(path), "ws://localhost/api/v1/attach", compression=None, ping_interval=None) as beside,
        dial(echo_url) as other,
    ):
        await attach(monitor, "one_stream", "round-trips")
        await attach(beside, "one_stream", "round-trips-by-path")
        for start in range(0, len(asks), 100):  # in turns, so that what else the machine does hits all
            block = asks[start : start + 100]
            decided += [await until(monitor, text, '"type":"decision"') for text in block]
            by_path += [await until(beside, text, '"type":"decision"') for text in block]
            echoed += [await until(other, text, "") for text in block]
    warm = len(asks) // 10
    decided, by_path, echoed = decided[warm:], by_path[warm:], echoed[warm:]
    lines = []
    for name, share, goal in (("p50", 0.5, 1.4), ("p99", 0.99, 2.5)):
        ours, beside_it, bare = (percentile(times, share) / 1e3 for times in (decided, by_path, echoed))
        lines.append(Line(f"round trip {name}", "µs", ours, bare, goal))
        lines.append(Line("  UNIX socket, beside TCP", "µs", beside_it, ours))
    return lines


async def until(peer: ClientConnection, text: str, wanted: str) -> int:
    """The nanoseconds until a frame of the wanted kind comes after `text` was sent."""
    began = time.perf_counter_ns()
    await peer.send(text)
    while wanted not in str(await peer.recv()):
        pass
    return time.perf_counter_ns() - began


async def throughput(server: Server, load: Load, size: int, session: str) -> Speed:
    """How fast a server gets to the ack of the last event."""
    frames = load.frames(size)
    async with dial(server.url) as peer, asyncio.timeout(PATIENCE):
        await attach(peer, load.spec, session)
        began, spent = time.perf_counter(), server.cpu
        await tell(peer, frames, len(load.events))
        took, spent = time.perf_counter() - began, server.cpu - spent
        await peer.send('{"type":"detach"}')
    return Speed(len(load.events) / took, spent / len(load.events))


async def tell(peer: ClientConnection, frames: list[str], last: int) -> None:
    """Send frames, until the ack of the last event, by its number."""

    async def send() -> None:
        for text in frames:
            await peer.send(text)

    sending = asyncio.create_task(send())
    acked = 0
    while acked < last:
        frame = msgspec.json.decode(await peer.recv())
        assert frame["type"] in ("ack", "violation", "credit"), frame
        acked = frame.get("upto", acked)
    await sending


def bare_throughput(load: Load, size: int, path: Path) -> Speed:
    """How fast a loop is that does the same work, and nothing else."""
    ready = plan(parse_spec(load.text, "benchmark").spec)
    order = orders(ready.spec)[0]
    judge = Judge(ready, make_engines(ready)[0], order, count(1))
    frames = [text for text in load.frames(size) if '"type":"clock"' not in text]
    database = sqlite3.connect(path, isolation_level=None)
    database.execute("PRAGMA journal_mode = WAL")
    database.execute("PRAGMA synchronous = FULL")
    database.executescript(DDL)
    began, spent = time.perf_counter(), time.process_time()
    rows: list[Row] = []
    for text in frames:
        frame = msgspec.json.decode(text)
        rows += [judged_row(ready, judge, event) for event in frame.get("events", (frame,))]
        if len(rows) >= COMMIT:
            insert(database, rows)
            rows = []
    insert(database, rows)
    took, spent = time.perf_counter() - began, time.process_time() - spent
    (found,) = database.execute("SELECT count(*) FROM steps").fetchone()
    assert found == len(load.events)
    database.close()
    return Speed(len(load.events) / took, spent / len(load.events))


def judged_row(ready: Plan, judge: Judge, event: Frame) -> Row:
    """The row of an event, once it is judged."""
    key = StreamKey(event["stream"], event["kind"])
    now = time.time_ns()
    signals, failed = ready.streams[key].project(event["data"])
    seen = Event(key, "m", event["seq"], event["stamp"], now, event["data"], "", event.get("call"))
    return step_row(1, stored(event["seq"], 0, judge.judge(Step(seen, signals, failed, event["stamp"]), now)))


def insert(database: sqlite3.Connection, rows: Sequence[Row]) -> None:
    """Insert and commit."""
    places = ",".join("?" * len(STEP_COLUMNS))
    database.execute("BEGIN IMMEDIATE")
    database.executemany(f"INSERT INTO steps ({','.join(STEP_COLUMNS)}) VALUES ({places})", rows)
    database.execute("COMMIT")


def statuses(number: int) -> list[Frame]:
    """Events of the one stream: each reports on a percentage of its own."""
    events = []
    for seq in range(1, number + 1):
        percentage = 100.0 - seq % 101
        status = 1 if percentage > 40 else 2 if percentage > 30 else 3
        data = {"id": seq, "accepted": seq, "percentage": percentage, "status": status}
        events.append(event("/battery_status", seq, seq * 10**7, data))
    return events


def battery_events(number: int) -> list[Frame]:
    """The simulated UAV's messages."""
    sys.path.insert(0, str(ROOT))
    from examples.battery_uav.simulator import simulate

    publications = simulate(countdowns=number // 300 + 1, events=number)
    return [
        event(sent.stream, seq, sent.stamp, sent.data, sent.kind) | ({} if sent.call is None else {"call": sent.call})
        for seq, sent in enumerate(publications, start=1)
    ]


def event(stream: str, seq: int, stamp: int, data: Frame, kind: str = "topic") -> Frame:
    return {"type": "event", "seq": seq, "stream": stream, "kind": kind, "stamp": stamp, "data": data}


def dial(url: str) -> connect:
    return connect(url, compression=None, proxy=None, ping_interval=None, open_timeout=PATIENCE)


async def attach(peer: ClientConnection, spec: str, session: str) -> None:
    wanted = {"type": "attach", "monitor": "m", "instance": "benchmark", "session": session, "spec": spec}
    await peer.send(_encode(wanted))
    answer = msgspec.json.decode(await peer.recv())
    assert answer["type"] == "attached", answer


def percentile(values: list[int], share: float) -> int:
    return sorted(values)[math.ceil(share * len(values)) - 1]


def _encode(frame: Frame) -> str:
    return msgspec.json.encode(frame).decode()


if __name__ == "__main__":
    main()
