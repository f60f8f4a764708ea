"""The fleet's last day: what was wrong within the hour, and when episodes began."""

from __future__ import annotations

import re
import time

import pytest
from playwright.async_api import Page, expect

from tests.whole.client import attached, make_event
from tests.whole.conftest import Starts

WRONG = {"now": (300, 0), "lately": (300, 200)}
"""How many seconds ago the events of each session begin and end to be violations."""


@pytest.fixture
def now() -> int:
    return time.time_ns()


async def test_what_was_wrong_within_the_hour_is_told_and_when(start: Starts, page: Page, now: int) -> None:
    server = start(ORACLE_HISTORY="memory")
    for name, (begin, end) in {**WRONG, "fine": (0, 0)}.items():
        async with attached(server, session=name, spec="single") as monitor:
            for i, ago in enumerate(range(400, -1, -100), 1):
                wrong = end <= ago <= begin and name != "fine"
                event = make_event(i, data={"v": 11 if wrong else 1})
                await monitor.send({**event, "stamp": now - ago * 10**9})
            await monitor.acked(5)
            monitor.vanish()
    await page.goto(f"{server.url}/")
    rows = page.locator(".sessions tbody tr")
    await expect(rows.first).to_have_text("Wrong now")
    await expect(rows.nth(1)).to_contain_text(re.compile("^now.*a_is_small"))
    await expect(rows.nth(2)).to_have_text("Wrong within the hour")
    await expect(rows.nth(3)).to_contain_text(re.compile(r"^latelya_is_small for 100\.0 s.*\d min ago"))
    await expect(rows.nth(3).locator(".strip .fails")).to_have_count(1)
    await expect(page.locator(".sessions td:first-child a").last).to_have_text("fine")
    day = page.locator(".day")
    await expect(day).to_contain_text("2 episodes in 24 h")
    await day.locator("button").first.press("Enter")
    listed = page.locator(".day + .wide tbody tr")
    await expect(listed.first).to_be_visible()
    await page.get_by_role("searchbox").fill("session:lately")
    await expect(day).to_contain_text("1 episode in 24 h")
    await expect(listed).to_have_count(1)
    await listed.get_by_role("link").click()
    await expect(page.locator(".verdict").get_by_role("heading")).to_contain_text("currently_false at step 2, ")
    await expect(page.locator(".before")).to_contain_text("none in this session, 1 in others")


async def test_an_episode_that_was_over_before_the_page_looked_is_told(start: Starts, page: Page, now: int) -> None:
    """It was never among those that are open, and nothing told the page to look, for a minute."""
    server = start(ORACLE_HISTORY="memory")
    await page.add_init_script(
        "const now = performance.now.bind(performance); performance.now = () => Math.min(8 * now(), 55000);"
    )
    async with attached(server, session="s", spec="single") as monitor:
        await monitor.send({**make_event(1, data={"v": 1}), "stamp": now - 10**10})
        await monitor.acked(1)
        await page.goto(f"{server.url}/")
        group = page.locator(".sessions tr.group")
        await expect(group).to_have_text("Fine")
        for seq, v in ((2, 11), (3, 1)):
            await monitor.send({**make_event(seq, data={"v": v}), "stamp": now + (seq - 5) * 2 * 10**9})
        await monitor.acked(3)
        await expect(group).to_have_text("Wrong within the hour")


@pytest.mark.parametrize("hours", [-30, 3])
async def test_a_browser_whose_clock_is_wrong_shows_the_same(start: Starts, page: Page, now: int, hours: int) -> None:
    server = start(ORACLE_HISTORY="memory")
    async with (
        attached(server, session="lately", spec="single") as lately,
        attached(server, session="failing", spec="single") as failing,
    ):
        for i, ago in enumerate((400, 300, 100), 1):
            for monitor, wrong in ((lately, i == 2), (failing, i > 1)):
                await monitor.send({**make_event(i, data={"v": 11 if wrong else 1}), "stamp": now - ago * 10**9})
        for monitor in (lately, failing):
            await monitor.acked(3)
        await page.add_init_script(f"const now = Date.now; Date.now = () => now() + {hours * 3_600_000}")
        await page.goto(f"{server.url}/")
        kinds = page.get_by_role("toolbar", name="Kinds")
        await expect(kinds).to_contain_text("Wrong now 1Not judged 0Degraded 0Wrong within the hour 1Fine 0")
        await expect(page.get_by_role("row", name="lately")).to_contain_text(re.compile(r"\d (s|min) ago"))
        await expect(page.get_by_role("row", name="failing").locator("td").nth(2)).to_have_text(re.compile(r"^\d min$"))
        await expect(page.locator(".day")).to_contain_text("2 episodes in 24 h")
        await expect(page.locator(".day .bars button")).not_to_have_count(0)
