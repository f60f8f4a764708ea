"""A page that is left open while the server forgets its session, and another one comes to have the name."""

from __future__ import annotations

import re

from playwright.async_api import Page, expect

from tests.processes import reserved_port
from tests.whole.client import attached, make_event, make_events
from tests.whole.conftest import Starts
from tests.whole.dashboard.test_timeline import painted

SECOND = 1000
HOUR = 3600 * SECOND


async def test_another_session_of_the_name_is_shown_without_anything_of_the_first(start: Starts, page: Page) -> None:
    """Its time was that of the first one, in which it had no step."""
    status = page.get_by_role("status")
    with reserved_port() as place:
        port = str(place.getsockname()[1])
        first = start(port=port, ORACLE_HISTORY="memory")
        async with attached(first, session="s", spec="single") as monitor:
            await monitor.send(
                make_events(*(make_event(i, at=HOUR + i * SECOND, data={"v": 11}) for i in range(1, 31)))
            )
            await monitor.acked(30)
            await page.goto(f"{first.url}/#/sessions/s?n=30")
            await expect(page.locator(".verdict").get_by_role("heading")).to_contain_text("at step 30, ")
            await expect(status).to_have_text("connected")
        first.stop()
        second = start(port=port, ORACLE_HISTORY="memory")
        await expect(status).to_contain_text("no session 's' is known. What is shown is of ")
        async with attached(second, session="s", spec="single") as monitor:
            await monitor.send(make_events(*(make_event(i, at=i * SECOND, data={"v": 1}) for i in range(1, 61))))
            await monitor.acked(60)
            await expect(page.locator(".now .card")).to_have_text(
                re.compile("^Its property holds · no episode so far$")
            )
            await expect(page.locator(".verdict")).to_be_empty()
            await page.locator(".time").get_by_role("button", name="All", exact=True).click()
            await painted(page, 0.5, "holds")
            await expect(page.locator(".time .shown")).to_have_text(re.compile(r"00:01\.000 to .*01:00\.000, UTC"))
