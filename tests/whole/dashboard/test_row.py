"""What the page says of an event that is an element of a message."""

from __future__ import annotations

from playwright.async_api import Page, expect

from tests.whole.client import attached, make_event
from tests.whole.harness import Server


async def test_a_row_is_named_wherever_its_event_is(server: Server, session: str, page: Page) -> None:
    transforms = [{"child": name, "z": z} for name, z in (("base", 0), ("arm", -1), ("hand", 1))]
    async with attached(server, session=session, spec="rows") as monitor:
        await monitor.send(make_event(1, "/tf", 1, {"transforms": transforms}))
        await monitor.acked(1)
    await page.goto(f"{server.url}/#/sessions/{session}?n=2")
    await expect(page.locator(".verdict")).to_contain_text("/tf (topic 1 of m1, row 1)")
    diagram = page.get_by_role("group", name="Events by time")
    await expect(diagram.locator("a")).to_have_count(3)
    said = [await each.get_attribute("aria-label") or "" for each in await diagram.locator("a").all()]
    assert [f"row {i}" in text for i, text in enumerate(said)] == [True] * 3
