"""A robot whose clock is far ahead: what it says stands where it arrived, and there the page finds it."""

from __future__ import annotations

import time

from playwright.async_api import Page, expect

from tests.whole.client import attached, make_event
from tests.whole.dashboard.focus import focus
from tests.whole.harness import Server

AHEAD = 86_400 * 10**9


async def test_what_is_skewed_is_found_where_its_lane_shows_it(server: Server, session: str, page: Page) -> None:
    """By its stamp, which is of tomorrow, the page went to the end of the session, and a click found nothing."""
    async with attached(server, session=session, spec="single") as monitor:
        for seq, (ago, ahead, v) in enumerate(((1000, 0, 1), (0, AHEAD, 11), (0, AHEAD, 12), (-1, 0, 1)), 1):
            stamp = time.time_ns() - ago * 10**9 + ahead
            await monitor.send(make_event(seq, data={"v": v}) | {"stamp": stamp})
            await monitor.acked(seq)
    arrived = server.records(session)[1]["arrived"]
    assert [r["n"] for r in server.records(session, since=arrived, until=arrived)] == [2]
    around = server.get(f"sessions/{session}/sequence", at=arrived, limit=1)
    assert [item["n"] for item in around["items"]] == [2]
    await page.goto(f"{server.url}/#/sessions/{session}?from={arrived - 10**9}&to={arrived + 2 * 10**9}")
    await expect(page.locator(".lane.property")).to_have_count(1)
    await focus(page.locator(".plots"))
    await page.keyboard.press("ArrowDown")
    await page.keyboard.press("Enter")
    await expect(page.locator(".verdict").get_by_role("heading").first).to_contain_text("currently_false at step 2")
    cursor = page.locator(".cursor")
    await expect(cursor).to_be_visible()
    await page.locator(".now .card.over").click()
    await expect(page.locator(".verdict .sequence svg text.when")).to_have_count(4)
    await expect(cursor).to_be_visible()
    when = page.locator(".verdict .sequence svg text.when")
    assert [text.endswith(" s") for text in await when.all_text_contents()] == [True, False, False, False], (
        "not a day on"
    )
