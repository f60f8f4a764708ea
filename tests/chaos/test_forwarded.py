"""A robot's server is killed while it forwards, and the centre's connections with it: both histories are the same."""

from __future__ import annotations

import asyncio
import random
from pathlib import Path
from typing import Any

import httpx

from tests.chaos.link import Frame
from tests.chaos.runs import ALONE, SESSION, assert_sound, specs, stream_through, told
from tests.chaos.served import PATIENCE, Served, reviving
from tests.postgres import Postgres

NAME = f"{SESSION}@robot7"
ASKED = ("verdicts?limit=1000", "violations?limit=1000", "episodes?limit=1000", "trace", "timeline")


async def answers(served: Served, session: str) -> dict[str, str]:
    """What is told of the session, by its name at the robot."""
    async with httpx.AsyncClient(base_url=f"{served.url}/api/v1/sessions/{session}", timeout=PATIENCE) as http:
        found = {path: (await http.get(path)).raise_for_status().text for path in ASKED}
    return {path: text.replace(session, SESSION) for path, text in found.items()}


async def test_what_a_robot_has_forwarded_is_the_same_at_the_centre(
    postgres: Postgres, trace: list[Frame], tmp_path: Path, chance: random.Random
) -> None:
    trace = trace[: len(trace) // 12]
    url, folder = postgres.empty(), specs(ALONE, tmp_path)
    more = {"forward": url, "origin": "robot7", "resume_within": "600"}
    async with (
        Served(folder, tmp_path / "robot", **more) as robot,
        Served(folder, tmp_path / "centre", history=url) as centre,
    ):
        api = f"{centre.url}/api/v1/sessions"

        def strike(_: object) -> None:
            postgres.kill_backends()
            robot.kill()

        middle = [told(trace) // 2]
        async with reviving(robot):
            links = await stream_through(robot, ALONE, trace, chance, middle, strike)
            await robot.up.wait()  # all may have been told before it was killed
        assert_sound(await robot.records(SESSION), links)
        async with httpx.AsyncClient(timeout=PATIENCE) as http:
            (await http.delete(f"{robot.url}/api/v1/sessions/{SESSION}")).raise_for_status()

            async def there() -> dict[str, Any]:
                found = await http.get(f"{api}/{NAME}")
                return found.json() if found.status_code == 200 else {}

            async with asyncio.timeout(PATIENCE):
                while (state := await there()).get("status") != "closed":
                    await asyncio.sleep(0.05)
            listed = (await http.get(api, params={"origin": "robot7"})).json()["items"]
            others = (await http.get(api, params={"origin": "robot8"})).json()["items"]
            assert ([each["id"] for each in listed], others) == ([NAME], [])
            assert (state["id"], state["origin"]) == (NAME, "robot7")
            metrics = (await http.get(f"{robot.url}/metrics")).text
            assert "oracle_forward_reached 1.0" in metrics
        assert await answers(centre, NAME) == await answers(robot, SESSION)
