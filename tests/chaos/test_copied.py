"""A server is killed, its history is copied, and one over the copy goes on: nobody can tell."""

from __future__ import annotations

import asyncio
import random
from pathlib import Path

import httpx

from tests.chaos.link import Frame
from tests.chaos.runs import ALONE, SESSION, assert_same, assert_sound, specs, stream_through, told, uninterrupted, void
from tests.chaos.served import PATIENCE, Served
from tests.postgres import Postgres
from tests.whole.harness import run

ASKED = ("verdicts?limit=1000", "violations?limit=1000", "episodes?limit=1000", "timeline", "trace", "changes",
         "verdicts/100/explanation")  # fmt: skip


async def copied(source: object, target: object) -> None:
    done = await asyncio.to_thread(run, "history", "copy", str(source), str(target))
    assert done.returncode == 0, done.stderr


async def answers(served: Served) -> dict[str, bytes]:
    """What is told of the session, over HTTP."""
    async with httpx.AsyncClient(base_url=f"{served.url}/api/v1/sessions/{SESSION}", timeout=PATIENCE) as http:
        found = {path: await http.get(path) for path in ASKED}
    return {path: answer.raise_for_status().content for path, answer in found.items()}


async def test_a_session_goes_on_over_a_copy_of_its_history(
    postgres: Postgres, trace: list[Frame], tmp_path: Path, chance: random.Random
) -> None:
    trace = trace[: len(trace) // 3]
    url, folder = postgres.empty(), specs(ALONE, tmp_path)
    async with Served(folder, tmp_path / "data", resume_within="600") as served, asyncio.TaskGroup() as tasks:

        async def move() -> None:
            served.kill()
            await served.ended()
            await copied(tmp_path / "data", url)
            served.set(history=url)
            await served.start()

        middle = [told(trace) // 3]
        links = await stream_through(
            served, ALONE, trace, chance, middle, lambda _: void(tasks.create_task(move()))
        )  # fmt: skip
        records = await served.records(SESSION)
        in_postgres = await answers(served)
        assert await served.stop() == 0
    assert_sound(records, links)
    assert_same(records, await uninterrupted(ALONE, trace, tmp_path, {}))
    await copied(url, tmp_path / "back")
    async with Served(folder, tmp_path / "back") as served:
        assert await answers(served) == in_postgres
