"""What robots have forwarded, by robot: at any server of the centre, by HTTP, on the command line and in a browser."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from playwright.async_api import Page, expect

from tests.history.backends import postgres
from tests.postgres import Postgres
from tests.processes import eventually
from tests.whole.client import attached, make_event
from tests.whole.conftest import copy_specs
from tests.whole.harness import Server, failed, problem, run

__all__ = ["postgres"]

RUNS = {"robot7": (1, 11), "robot70": (11, 1)}
"""What each robot has seen: the first one fails still."""
STANDS = {"run@robot7": True, "run@robot70": False, "direct": True}
"""Each session's episode, and whether it is open."""


@pytest.fixture(scope="module")
def centre(postgres: Postgres, tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[Server]]:
    """Two servers over the history to which two robots have forwarded theirs; the second one has a session too."""
    folder, url = tmp_path_factory.mktemp("centre"), postgres.empty()
    specs = copy_specs(folder / "specs")
    with ExitStack() as stack:
        nodes = [stack.enter_context(_node(specs, folder / name, url)) for name in "ab"]
        with ExitStack() as robots:
            for name, said in RUNS.items():
                settings = {"ORACLE_FORWARD": url, "ORACLE_ORIGIN": name}
                asyncio.run(_drive(robots.enter_context(Server(specs, folder / name, **settings)), "run", said))
            asyncio.run(_drive(nodes[1], "direct", (11,)))
            eventually(lambda: _open(nodes[0]), lambda found: found == STANDS)
        yield nodes


def _node(specs: Path, data: Path, url: str) -> Server:
    return Server(specs, data, ORACLE_HISTORY=url, ORACLE_NODE=data.name)


def _open(node: Server) -> dict[str, bool]:
    return {each["session"]: each["open"] for each in node.get("episodes")["items"]}


async def _drive(server: Server, session: str, said: tuple[int, ...]) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        for seq, v in enumerate(said, 1):
            await monitor.send(make_event(seq, data={"v": v}) | {"stamp": time.time_ns()})
        await monitor.acked(len(said))


def test_any_server_tells_sessions_and_episodes_by_robot(centre: list[Server]) -> None:
    for node in centre:
        for origin, own in {"robot7": ["run@robot7"], "robot70": ["run@robot70"], "robot": []}.items():
            sessions = node.get("sessions", origin=origin)["items"]
            assert [(state["id"], state["origin"]) for state in sessions] == [(name, origin) for name in own]
            assert [each["session"] for each in node.get("episodes", origin=origin)["items"]] == own
        (failing,) = node.get("episodes", origin="robot7", open=True)["items"]
        assert failing["property"] == "a_is_small"
        assert node.get("episodes", origin="robot70", open=True)["items"] == []
        origins = {state["id"]: state["origin"] for state in node.get("sessions")["items"]}
        assert origins == {"run@robot7": "robot7", "run@robot70": "robot70", "direct": None}
        for path in ("sessions", "episodes"):
            problem(node.http.get(f"/api/v1/{path}", params={"origin": "robot 7"}), 422)


def test_the_command_line_tells_them(centre: list[Server]) -> None:
    for node in centre:
        place = {"ORACLE_URL": node.url}
        told = json.loads(run("episodes", "--origin", "robot7", "--json", **place).stdout)["items"]
        assert [each["session"] for each in told] == ["run@robot7"]
        listed = run("sessions", "--origin", "robot70", **place).stdout
        assert "run@robot70" in listed
        assert "run@robot7 " not in listed
        assert "direct" not in listed
        assert "--origin" in failed("episodes", "direct", "--origin", "robot7", **place)


async def test_the_list_is_searched_by_robot_and_says_whose_each_is(centre: list[Server], page: Page) -> None:
    names = page.locator(".sessions td:first-child > a")
    await page.goto(f"{centre[0].url}/")
    await expect(names).to_have_text(["run@robot7", "direct", "run@robot70"])
    cells = page.locator(".sessions td:first-child")
    await expect(cells).to_have_text(["run@robot7 from robot7", "direct", "run@robot70 from robot70"])
    day = page.get_by_role("region", name="Episodes in 24 hours")
    await expect(day).to_contain_text("3 episodes in 24 h")
    await page.get_by_role("searchbox").fill("origin:robot70")
    await expect(names).to_have_text(["run@robot70"])
    await expect(day).to_contain_text("1 episode in 24 h")
    await page.get_by_role("searchbox").fill("origin:robot7 property:a_is")
    await expect(names).to_have_text(["run@robot7", "run@robot70"])
    await page.get_by_role("searchbox").fill("")
    await cells.last.get_by_role("link", name="robot70", exact=True).click()
    await expect(names).to_have_text(["run@robot70"])
    await expect(page.get_by_role("searchbox")).to_have_value("origin:robot70")
    await names.click()
    await expect(page.locator(".facts")).to_contain_text("forwarded from robot70")
    await page.locator(".facts").get_by_role("link", name="robot70").click()
    await expect(names).to_have_text(["run@robot70"])
