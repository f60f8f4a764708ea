"""A session on paper: its explanation is there to the end."""

from __future__ import annotations

from playwright.async_api import Page, expect

from tests.whole.client import attached, make_event
from tests.whole.conftest import Starts


async def test_all_of_an_explanation_is_printed(start: Starts, page: Page) -> None:
    server = start(ORACLE_HISTORY="memory")
    async with attached(server, session="s", spec="single") as monitor:
        await monitor.send(make_event(1, data={"v": 11}))
        await monitor.acked(1)
        await page.set_viewport_size({"width": 1280, "height": 300})
        await page.goto(f"{server.url}/#/sessions/s?n=1")
        verdict, cut = page.locator(".verdict"), "(element) => element.scrollHeight > element.clientHeight"
        await expect(verdict.locator(".parts")).to_be_visible()
        assert await verdict.evaluate(cut), "on a low screen it is scrolled"
        await page.emulate_media(media="print")
        assert not await verdict.evaluate(cut)
        await expect(page.locator(".lane.property").get_by_text("a_is_small")).to_be_visible()
