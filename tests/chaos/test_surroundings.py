"""What is around the server fails: the network, the clock, the disk."""

from __future__ import annotations

import asyncio
import json
import random
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import httpx
import pytest

from tests.chaos.by_hand import attached, event, say, until_acked
from tests.chaos.disk import Disk, Unmountable, small_disk
from tests.chaos.link import Frame, Link
from tests.chaos.runs import (
    ALONE,
    PAIR,
    SESSION,
    Layout,
    assert_same,
    assert_sound,
    each_layout,
    specs,
    stream_through,
    told,
    uninterrupted,
    void,
)
from tests.chaos.served import PATIENCE, Served
from tests.chaos.tunnel import Tunnel

FAILED = "the history can't be written"
"""What the log says of it."""
TURNED_BY_SIGNALS = """
import signal, time
real, offset = time.time_ns, 0
def turn(number, frame):
    global offset
    offset += 60 * 10**9 * (1 if number == signal.SIGUSR1 else -1)
time.time_ns = lambda: real() + offset
signal.signal(signal.SIGUSR1, turn)
signal.signal(signal.SIGUSR2, turn)
"""
"""A clock that is set forward, or back, by a minute: six times forward is less than `max_delay` still."""
STOPS_SOON = "from oracle_server.sessions import stopping; stopping._FLUSH_WITHIN = 0.1"
"""It waits no longer for a history that can't be written."""


@each_layout
async def test_connections_half_open(
    layout: Layout, trace: list[Frame], tmp_path: Path, chance: random.Random, known: dict[str, list[Frame]]
) -> None:
    """The monitors notice, and come back; to the server their old connections still stand."""
    points = sorted(chance.sample(range(told(trace) * 2 // 3), 10))
    async with Served(specs(layout, tmp_path), tmp_path / "data") as served, Tunnel(served) as tunnel:

        def strike(links: list[Link]) -> None:
            tunnel.go_dead()
            for link in links:
                link.cut()

        links = await stream_through(tunnel, layout, trace, chance, points, strike)
        records = await served.records(SESSION)
        assert tunnel.dead
        assert not served.complaints
    assert_sound(records, links)
    assert_same(records, await uninterrupted(layout, trace, tmp_path, known))


async def test_a_clock_that_jumps(
    trace: list[Frame], tmp_path: Path, chance: random.Random, known: dict[str, list[Frame]]
) -> None:
    points = sorted(chance.sample(range(told(trace) * 2 // 3), 12))
    async with Served(specs(PAIR, tmp_path), tmp_path / "data", early=TURNED_BY_SIGNALS, resume_within="600") as served:
        turns = iter([signal.SIGUSR1, signal.SIGUSR2, signal.SIGUSR2, signal.SIGUSR1] * 3)
        links = await stream_through(served, PAIR, trace, chance, points, lambda _: served.signal(next(turns)))
        assert next(turns, None) is None
        records = await served.records(SESSION)
        assert all(told["event"].startswith("the wall clock was set") for told in served.complaints)
    assert_sound(records, links)
    arrivals = [record["judged"] for record in records]
    assert arrivals == sorted(arrivals)
    assert_same(records, await uninterrupted(PAIR, trace, tmp_path, known))


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Disk]:
    try:
        with small_disk(tmp_path / "disk") as disk:
            yield disk
    except Unmountable as error:
        pytest.skip(str(error))


async def test_a_disk_that_is_full_for_a_while(
    disk: Disk, trace: list[Frame], tmp_path: Path, chance: random.Random
) -> None:
    """Nothing is acked that is not kept, and guarded events are denied; then the session goes on."""
    point = chance.randrange(told(trace) // 4, told(trace) // 2)
    async with Served(specs(ALONE, tmp_path), disk.folder / "data") as served, asyncio.TaskGroup() as tasks:
        refused: list[str] = []

        async def be_full() -> None:
            disk.fill()
            await served.said(FAILED)
            refused.append(await readiness(served, 503))
            disk.free()
            await served.said("the history can be written again")
            await readiness(served, 200)

        links = await stream_through(
            served, ALONE, trace, chance, [point], lambda _: void(tasks.create_task(be_full()))
        )
        records = await served.records(SESSION)
        assert [line["event"] for line in served.complaints] == [FAILED]
        assert await served.stop() == 0
        await served.start()
        assert await served.records(SESSION) == records
    assert_sound(records, links)
    assert "full" in refused[0]
    unknown = [record for record in records if record["outcome"] == "unknown"]
    assert all(record["decision"] == "deny" for record in unknown if record["kind"] == "request")
    last = max((record["n"] for record in unknown), default=0)
    assert all(record["degraded"] for record in records if record["n"] > last and unknown)


class FailingDisk(NamedTuple):
    """A disk of its own that can turn read-only under who writes to it, and be put right once nobody does."""

    folder: Path
    fail: Callable[[], None]
    mend: Callable[[], None]


@pytest.fixture
def failing_disk(tmp_path: Path) -> Iterator[FailingDisk]:
    folder, image = tmp_path / "failing", tmp_path / "image"
    folder.mkdir()
    with image.open("wb") as file:
        file.truncate(2**25)

    def mount() -> str:
        command: list[str | Path] = ["mount", "-o", "loop,errors=remount-ro", image, folder]
        subprocess.run(command, capture_output=True, check=True)
        shown = subprocess.run(["findmnt", "-n", "-o", "SOURCE", folder], capture_output=True, check=True, text=True)
        return shown.stdout.strip().rpartition("/")[2]

    try:
        subprocess.run(["mkfs.ext4", "-q", image], capture_output=True, check=True)
        devices = [mount()]
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("a disk of its own can't be mounted here")

    def fail() -> None:
        Path(f"/sys/fs/ext4/{devices[-1]}/trigger_fs_error").write_text("1")

    def mend() -> None:
        subprocess.run(["umount", folder], check=True)
        devices.append(mount())

    yield FailingDisk(folder, fail, mend)
    subprocess.run(["umount", folder], check=True)


async def test_a_disk_that_turns_read_only(failing_disk: FailingDisk, tmp_path: Path) -> None:
    """What was acked is there when the disk is put right, nothing else was acked, and what is guarded was denied."""
    half = [event(seq, {"id": seq, "percentage": 50.0}) | {"stream": "/battery_percentage"} for seq in range(1, 101)]
    request = {"stream": "/SetLED", "kind": "request", "ask": True}
    async with (
        asyncio.timeout(2 * PATIENCE),
        Served(specs(ALONE, tmp_path), failing_disk.folder / "data", STOPS_SOON) as served,
    ):
        async with attached(served, "battery_uav", "s", "m") as socket:
            await say(socket, half[:50], at_once=50)
            await until_acked(socket, 50)
            failing_disk.fail()
            await say(socket, half[50:], at_once=50)
            await served.said(FAILED)
            assert "read-only" in await readiness(served, 503)
            await say(socket, [event(101, {"id": 1, "status": 1}) | request])
            frames = [json.loads(await socket.recv())]
            while frames[-1]["type"] != "decision":
                frames.append(json.loads(await socket.recv()))
            assert frames[-1]["decision"] == "deny"
            assert not [frame for frame in frames if frame["type"] == "ack" and frame["upto"] > 50]
            assert await served.stop() == 0
        failing_disk.mend()
        await served.start()
        kept = await served.records("s")
        assert sorted({record["seq"] for record in kept}) == list(range(1, 51))
        async with attached(served, "battery_uav", "s", "m") as socket:
            await say(socket, half[50:], at_once=50)
            await until_acked(socket, 100)
        records = await served.records("s")
        assert records[: len(kept)] == kept
        assert [record["n"] for record in records] == list(range(1, len(records) + 1))
        assert sorted(record["seq"] for record in records[::6]) == list(range(1, 101))


async def readiness(served: Served, status: int) -> str:
    """What `/readyz` says, with this status."""
    async with httpx.AsyncClient(base_url=served.url, trust_env=False, timeout=PATIENCE) as http:
        response = await http.get("/readyz")
    assert response.status_code == status
    return response.text


async def test_a_server_with_a_full_disk_can_be_stopped(disk: Disk, tmp_path: Path) -> None:
    async with Served(specs(ALONE, tmp_path), disk.folder / "data", STOPS_SOON) as served:
        async with attached(served, "battery_uav", "s", "m") as socket:
            disk.fill()
            text = "x" * 500_000  # more than the room that is left in the files
            for seq in range(1, 20):
                data = {"id": text, "percentage": 1.0}
                await say(socket, [event(seq, data) | {"stream": "/battery_percentage"}])
            await served.said(FAILED)
            assert await served.stop() == 0
        disk.free()
        await served.start()
        assert await served.records("s") == []
