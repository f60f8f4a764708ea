"""Servers over one PostgreSQL, of which the one that has the session ends or stands still while a trace comes in.

Nothing acked is lost, each number is there once, and what monitors were told is what is recorded and what one server
would have said.
"""

from __future__ import annotations

import asyncio
import json
import random
from pathlib import Path

import httpx
import pytest
from websockets.asyncio.client import connect

from tests.chaos.fleet import Fleet
from tests.chaos.link import Frame, Link
from tests.chaos.runs import (
    SESSION,
    TRIO,
    assert_same,
    assert_sound,
    attach_frame,
    specs,
    stream_through,
    told,
    uninterrupted,
)
from tests.chaos.served import Served
from tests.postgres import Postgres
from tests.processes import PATIENCE

LEASE = 3.0
"""Seconds: longer than a busy machine lets a server stand still, else it is taken over where nobody struck it."""


def servers(url: str, folder: Path, names: str) -> dict[str, Served]:
    found = specs(TRIO, folder)
    more = {"history": url, "lease": str(LEASE), "resume_within": "600"}
    return {name: Served(found, folder / name, node=name, advertise=f"http://{name}", **more) for name in names}


@pytest.mark.parametrize(("fault", "names"), [("it is killed", "abc"), ("it stands still", "ab")])
async def test_another_server_goes_on(
    fault: str,
    names: str,
    postgres: Postgres,
    trace: list[Frame],
    tmp_path: Path,
    chance: random.Random,
    known: dict[str, list[Frame]],
) -> None:
    url = postgres.empty()

    def owner() -> str:
        ((node,),) = postgres.do(f"SELECT node FROM owners WHERE id = '{SESSION}'", url)
        return str(node)

    async def strike() -> None:
        async with one_at_a_time:
            await strike_owner()

    async def strike_owner() -> None:
        struck = await asyncio.to_thread(owner)
        end = asyncio.create_task(fleet.nodes[struck].ended())
        if fault == "it is killed":
            fleet.restarts.clear()
            fleet.nodes[struck].kill()
        else:
            fleet.nodes[struck].freeze()
        async with asyncio.timeout(PATIENCE):
            while await asyncio.to_thread(owner) == struck:
                await asyncio.sleep(0.02)
        fleet.restarts.set()
        if fault != "it is killed":
            fleet.nodes[struck].thaw()
            assert await end == 2, "it finds that it is no node any more"
        moves.append(struck)

    def begin(_: list[Link]) -> None:
        strikes.append(tasks.create_task(strike()))

    one_at_a_time = asyncio.Lock()
    moves: list[str] = []
    strikes: list[asyncio.Task[None]] = []
    points = sorted(chance.sample(range(len(trace) // 20, told(trace) * 2 // 3), len(names) - 1))
    async with Fleet(servers(url, tmp_path, names)) as fleet, asyncio.TaskGroup() as tasks:
        links = await stream_through(fleet, TRIO, trace, chance, points, begin, moves=True)
        await asyncio.gather(*strikes)
        records = await fleet.records(SESSION)
    assert len(moves) == len(points)
    assert all(told_there == records[0] for told_there in records)
    assert_sound(records[0], links)
    assert_same(records[0], await uninterrupted(TRIO, trace, tmp_path, known))


async def test_a_session_is_read_at_any_server_and_judged_at_one(postgres: Postgres, tmp_path: Path) -> None:
    async with Fleet(servers(postgres.empty(), tmp_path, "ab")) as fleet:
        a, b = fleet.nodes["a"], fleet.nodes["b"]
        async with httpx.AsyncClient(timeout=PATIENCE, trust_env=False) as http:
            made = await http.post(f"{a.url}/api/v1/sessions", json={"spec": "battery_uav", "id": SESSION})
            assert made.status_code == 201
            there, here = await a.get(f"sessions/{SESSION}"), await b.get(f"sessions/{SESSION}")
            assert here["node"] == "a"
            assert here["status"] == there["status"] == "open"
            assert here.keys() - {"node"} == there.keys()
            assert [state["id"] for state in (await b.get("sessions"))["items"]] == [SESSION]
            again = await http.post(f"{b.url}/api/v1/sessions", json={"spec": "battery_uav", "id": SESSION})
            assert again.status_code == 409
            refused = await http.delete(f"{b.url}/api/v1/sessions/{SESSION}")
            assert refused.status_code == 409
            assert "at the server 'a', http://a" in refused.text
            async with http.stream("GET", f"{b.url}/api/v1/sessions/{SESSION}/stream") as stream:
                lines = stream.aiter_lines()
                assert await anext(lines) == ": the verdicts of a session"
                assert (await http.delete(f"{a.url}/api/v1/sessions/{SESSION}")).status_code == 200
                assert "event: closed" in [line async for line in lines]
            assert (await b.get(f"sessions/{SESSION}"))["status"] == "closed"
        await _assert_told_of_each_other(a, b)


async def _assert_told_of_each_other(a: Served, b: Served) -> None:
    """A monitor that attaches at the other server is told where its session is."""
    frame = attach_frame(TRIO, "sensors") | {"session": "s2"}
    async with connect(a.attach_url, proxy=None) as first, connect(b.attach_url, proxy=None) as second:
        await first.send(json.dumps(frame))
        assert json.loads(await first.recv())["type"] == "attached"
        await second.send(json.dumps(attach_frame(TRIO, "lights") | {"session": "s2"}))
        answer = json.loads(await second.recv())
        assert (answer["type"], answer["code"], answer["url"]) == ("error", "moved", "http://a")
        await second.wait_closed()
        assert second.close_code == 1012
