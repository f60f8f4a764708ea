"""Many monitors at once: each keeps its order and gets what is its own; one that misbehaves disturbs no other."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from websockets.asyncio.client import ClientConnection
from websockets.exceptions import ConnectionClosed

from tests.chaos.by_hand import attached, event, say, until_acked
from tests.chaos.link import Frame
from tests.chaos.served import PATIENCE, Served
from tests.whole.test_stream import connections

EVENTS = 50
LIMIT = 2 * PATIENCE

CROWD_SPEC = """
id: crowd
ordering: {by: publication, max_delay: 200ms}
streams:
  - topic: /t
    signals: {ok: msg.ok}
properties:
  - {id: fine, formula: '{ok: true}'}
"""
# Fails also where two events change places, which only one monitor's can be held to.
SINGLE_SPEC = """
id: single
streams:
  - topic: /t
    signals: {ok: msg.ok, odd: msg.odd}
properties:
  - id: fine
    formula: '{ok: true} and not ({odd: true} and pre{odd: true}) and not ({odd: false} and pre{odd: false})'
"""
# All its properties are violated at each event that is not ok after one that is.
LOUD = 16
LOUD_SPEC = """
id: loud
ordering: {by: publication, max_delay: none}
streams:
  - topic: /t
    signals: {ok: msg.ok, note: msg.note}
properties:
""" + "".join(f"  - {{id: {'p' * 50}{i}, formula: '{{ok: true}}'}}\n" for i in range(LOUD))


UNASKED = f"from oracle_server import server; server.PING = {LIMIT}"
"""No ping is to be answered: where much else runs, what speaks for two hundred may have no turn for 5 s."""


@pytest.fixture(params=[""])
async def served(request: pytest.FixtureRequest, tmp_path: Path) -> AsyncIterator[Served]:
    folder = tmp_path / "specs"
    folder.mkdir()
    for name, text in {"crowd": CROWD_SPEC, "single": SINGLE_SPEC, "loud": LOUD_SPEC}.items():
        (folder / f"{name}.yaml").write_text(text)
    async with Served(folder, tmp_path / "data", request.param, resume_within="0.5") as server:
        yield server
        assert not server.complaints


@pytest.mark.parametrize("served", [UNASKED], indirect=True, ids=[""])
@pytest.mark.parametrize(("spec", "sessions", "monitors"), [("single", 200, 1), ("crowd", 20, 10)])
async def test_two_hundred_at_once(served: Served, spec: str, sessions: int, monitors: int) -> None:
    names = [(f"s{i}", f"m{k}") for i in range(sessions) for k in range(monitors)]
    async with asyncio.timeout(LIMIT), asyncio.TaskGroup() as tasks:
        talks = [tasks.create_task(talk(served, spec, *name)) for name in names]
    for task in talks:
        received = task.result()
        acks = [frame["upto"] for frame in received if frame["type"] == "ack"]
        assert acks == sorted(set(acks))
        assert acks[-1] == EVENTS
        decisions = [frame for frame in received if frame["type"] == "decision"]
        assert [frame["seq"] for frame in decisions] == [seq for seq in range(1, EVENTS + 1) if asks(seq)]
        assert all((frame["verdicts"]["fine"] == "currently_true") == is_ok(frame["seq"]) for frame in decisions)
        assert not [frame for frame in received if frame["type"] == "error"]
    for i in range(sessions):
        records = await served.records(f"s{i}")
        assert [record["n"] for record in records] == list(range(1, EVENTS * monitors + 1))
        assert all((record["outcome"] == "currently_true") == is_ok(record["seq"]) for record in records)
        for k in range(monitors):
            own = [record["seq"] for record in records if record["monitor"] == f"m{k}"]
            assert own == list(range(1, EVENTS + 1))


async def test_a_crawler_is_cut_off_and_disturbs_nobody(served: Served) -> None:
    count = 2_000
    total = count // 2 * LOUD
    async with asyncio.timeout(LIMIT), attached(served, "loud", "s", "crawler", streams=[]) as crawler:
        async with attached(served, "loud", "s", "speaker") as speaker, asyncio.TaskGroup() as tasks:
            other = tasks.create_task(talk(served, "crowd", "elsewhere", "m"))
            tasks.create_task(say(speaker, [loud(seq) for seq in range(1, count + 1)], at_once=20))
            await until_acked(speaker, count)
        assert other.result()
        while any(m["name"] == "crawler" and m["connected"] for m in (await served.get("sessions/s"))["monitors"]):
            pass
        read = [json.loads(text) async for text in rest_of(crawler)]
        assert len([frame for frame in read if frame["type"] == "violation"]) < total
        async with attached(served, "loud", "s", "crawler", streams=[]):
            pass


async def test_who_reads_is_not_cut_off_by_a_burst(served: Served) -> None:
    """A monitor comes back with what piled up while it was away, and every second event breaks every property."""
    count = 2_000
    async with asyncio.timeout(LIMIT), attached(served, "loud", "s", "m") as monitor, asyncio.TaskGroup() as tasks:
        tasks.create_task(say(monitor, [loud(seq, note="") for seq in range(1, count + 1)], at_once=count))
        violations = acked = 0
        while acked < count or violations < count // 2 * LOUD:
            frame = json.loads(await monitor.recv())
            assert frame["type"] in ("ack", "violation", "credit"), frame
            violations += frame["type"] == "violation"
            acked = frame.get("upto", acked)


async def test_who_hangs_loses_its_place(served: Served) -> None:
    """It answers no pings, and more than the sockets take in waits for it: the others wait for it no longer."""
    count = 9_000
    async with (
        asyncio.timeout(PATIENCE),
        attached(served, "loud", "s", "witness") as witness,
        attached(served, "loud", "s", "hanging") as hanging,
    ):
        await witness.send(json.dumps({"type": "clock", "stamps": [{"stream": "/t", "stamp": count + 1}]}))
        await say(hanging, [event(seq, {"ok": True}) | {"ask": True} for seq in range(1, count + 1)])
        await say(witness, [event(1, {"ok": True}) | {"stamp": count + 2}])
        await until_acked(witness, 1)
        way = served.port, hanging.local_address[1]
        while await asyncio.to_thread(connections, *way):
            pass


async def talk(served: Served, spec: str, session: str, monitor: str) -> list[Frame]:
    """Send all events and detach; what was received until the end."""
    received: list[Frame] = []
    async with attached(served, spec, session, monitor) as socket, asyncio.TaskGroup() as tasks:
        events = [
            event(seq, {"ok": is_ok(seq), "odd": seq % 2 == 1}) | {"ask": asks(seq)} for seq in range(1, EVENTS + 1)
        ]
        tasks.create_task(say(socket, [*events, {"type": "detach"}]))
        while not received or received[-1]["type"] != "detached":
            received.append(json.loads(await socket.recv()))
    return received


async def rest_of(socket: ClientConnection) -> AsyncIterator[str]:
    """What can still be read, until the other side ends the connection."""
    try:
        while True:
            yield str(await socket.recv())
    except ConnectionClosed:
        pass


def loud(seq: int, note: str = "x" * 1_000) -> Frame:
    return event(seq, {"ok": seq % 2 == 1, "note": note})


def asks(seq: int) -> bool:
    return seq % 7 == 0


def is_ok(seq: int) -> bool:
    return seq % 5 != 0
