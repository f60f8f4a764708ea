"""Times of the page are told in the time zone of its browser, which it names."""

from __future__ import annotations

import re
from datetime import UTC, datetime

import pytest
from playwright.async_api import Page, expect

from tests.whole.client import attached, make_event
from tests.whole.harness import Server


@pytest.mark.parametrize(
    ("where", "shown"),
    [
        ("Asia/Kolkata", r"06:00:00\.000 to .* 07:00:00\.000, UTC\+5:30$"),
        ("America/New_York", r"20:30:00\.000 to .* 21:30:00\.000, UTC-4$"),
        ("Europe/Berlin", r"02:30:00\.000, UTC\+2 to .* 02:30:00\.000, UTC\+1$"),
        ("UTC", r"00:30:00\.000 to .* 01:30:00\.000, UTC$"),
    ],
)
async def test_times_are_told_with_their_zone(server: Server, session: str, page: Page, where: str, shown: str) -> None:
    """Explanations have theirs in UTC, and in autumn one hour comes twice."""
    await (await page.context.new_cdp_session(page)).send("Emulation.setTimezoneOverride", {"timezoneId": where})
    begin = int(datetime(2026, 10, 25, 0, 30, tzinfo=UTC).timestamp())
    async with attached(server, session=session, spec="single") as monitor:
        for seq, at in enumerate((begin, begin + 3600), 1):
            await monitor.send(make_event(seq, data={"v": 1}) | {"stamp": at * 10**9})
        await monitor.acked(2)
        await page.goto(f"{server.url}/#/sessions/{session}")
        await expect(page.locator(".time .shown")).to_contain_text("UTC")  # it knows how far the session reaches
        await page.locator(".time").get_by_role("button", name="All", exact=True).click()
        await expect(page.locator(".time .shown")).to_have_text(re.compile(shown))
