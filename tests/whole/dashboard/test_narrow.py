"""The fleet on a phone."""

from __future__ import annotations

from playwright.async_api import Page, expect

from tests.whole.client import attached, make_event
from tests.whole.harness import Server


async def test_a_long_name_covers_nothing(server: Server, session: str, page: Page) -> None:
    name = session.ljust(64, "x")
    await page.set_viewport_size({"width": 390, "height": 844})
    async with attached(server, session=name, spec="single") as monitor:
        await monitor.send(make_event(1, data={"v": 99}))
        await monitor.acked(1)
        await page.goto(f"{server.url}/#/?q={name}")
        row = page.get_by_role("row", name=name)
        await expect(row.locator("td:nth-child(3)")).not_to_be_empty()
        right = await row.get_by_role("link", name=name).evaluate("link => link.getBoundingClientRect().right")
        left = await row.locator("td:nth-child(3)").evaluate("cell => cell.getBoundingClientRect().left")
        assert right <= left
