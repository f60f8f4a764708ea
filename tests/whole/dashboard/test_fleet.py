"""A thousand sessions in one list, as somebody in front of a browser finds those that need them."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, closing
from pathlib import Path

import pytest_asyncio
from playwright.async_api import Page, Route, expect

from tests.whole.client import attached, make_event
from tests.whole.conftest import Starts
from tests.whole.dashboard.focus import focus
from tests.whole.harness import Server

MANY, EACH = 1000, 20
WRONG = {"robot-0700": 5, "robot-0300": 2}
"""Sessions with an open episode, and the second from which on they fail."""


@pytest_asyncio.fixture(loop_scope="session")
async def fleet(start: Starts, tmp_path: Path) -> AsyncIterator[Server]:
    """A server with a thousand sessions, fifty of them open, of which two fail and one is sound."""
    server = start()
    for name in ("robot-0000", "robot-0001"):
        assert server.http.post("/api/v1/sessions", json={"spec": "single", "id": name}).status_code == 201
    assert server.http.delete("/api/v1/sessions/robot-0001").status_code == 200
    assert server.stop() == 0
    with closing(sqlite3.connect(tmp_path / "data" / "history.sqlite")) as database, database:
        _multiply(database)
    server = start()
    async with AsyncExitStack() as monitors:
        for name, since in {**WRONG, "robot-0500": 99}.items():
            monitor = await monitors.enter_async_context(attached(server, session=name, spec="single"))
            said = [11 if at >= since else 1 for at in range(1, 10)]
            await monitor.send(*(make_event(at, at=at * 1000, data={"v": v}) for at, v in enumerate(said, 1)))
            await monitor.acked(9)
        yield server


def _multiply(database: sqlite3.Connection) -> None:
    """Copy the two sessions that are there until there are a thousand: each twentieth is open."""
    names = [row[1] for row in database.execute("PRAGMA table_info(sessions)")]
    models = [dict(zip(names, row, strict=True)) for row in database.execute("SELECT * FROM sessions ORDER BY id")]
    for number in range(len(models), MANY):
        model, name = models[number % EACH > 0], f"robot-{number:04}"
        state = model["state"] and model["state"].replace(model["id"], name)
        row = {**model, "number": number + 10, "id": name, "state": state}
        database.execute(
            f"INSERT INTO sessions ({', '.join(row)}) VALUES ({', '.join('?' * len(row))})", [*row.values()]
        )


async def test_who_needs_somebody_is_found_among_a_thousand(fleet: Server, page: Page) -> None:
    names = page.locator(".sessions td:first-child a")
    async with page.expect_response(lambda answer: answer.status == 304):  # what has not changed is not sent again
        await page.goto(f"{fleet.url}/")
    kinds = page.get_by_role("toolbar", name="Kinds")
    await expect(kinds).to_contain_text(f"All {MANY}")
    for name, count in {"Wrong now": 2, "Fine": 1, "Idle": MANY // EACH - 3, "Closed": MANY - MANY // EACH}.items():
        await expect(kinds).to_contain_text(f"{name} {count}")
    await expect(names).to_have_count(200)
    assert (await names.all_inner_texts())[:3] == ["robot-0300", "robot-0700", "robot-0500"], (
        "who fails longest is first"
    )
    first = page.locator(".sessions tr.wrong").first
    await expect(first).to_contain_text("a_is_small")
    await expect(first).to_contain_text("v = 11")
    await page.get_by_role("button", name=f"Show more of {MANY}").click()
    await expect(names).to_have_count(MANY)
    await page.keyboard.press("/")
    await page.keyboard.type("property:a_is 07")
    await expect(names).to_have_text(["robot-0700"])
    await page.get_by_role("searchbox").fill("0123")
    await expect(names).to_have_text(["robot-0123"])
    await expect(page).to_have_url(re.compile("q=0123$"))
    await page.reload()
    await expect(names).to_have_text(["robot-0123"])
    await page.get_by_role("searchbox").fill("")
    await kinds.get_by_role("button", name="Wrong now").click()
    await expect(names).to_have_count(2)
    assert await page.locator(".sessions a[tabindex='0']").count() == 1, "the list is one stop"
    await focus(names.first)
    await page.keyboard.press("ArrowDown")
    await expect(names.nth(1)).to_be_focused()
    await page.locator(".sessions a.bad").first.click()
    await expect(page.locator(".verdict").get_by_role("heading")).to_contain_text("currently_false at step 2")


async def test_that_older_sessions_are_not_listed_is_said(server: Server, session: str, page: Page) -> None:
    """A server lists the last thousand closed sessions: one that is not found may be older."""
    assert server.http.post("/api/v1/sessions", json={"spec": "single", "id": session}).status_code == 201
    assert server.http.delete(f"/api/v1/sessions/{session}").status_code == 200

    async def multiply(route: Route) -> None:
        found = (await (await route.fetch()).json())["items"]
        one = next(each for each in found if each["id"] == session)
        await route.fulfill(json={"items": [{**one, "id": f"{session}-{i}"} for i in range(1000)]})

    await page.route("**/api/v1/sessions?**", multiply)
    await page.goto(f"{server.url}/#/?q=not-there")
    await expect(page.locator(".found")).to_contain_text("None of 1000 is like that.")
    await expect(page.locator(".found")).to_contain_text("Of closed sessions the last 1000 are here")
