"""What may be wrong, though nothing is violated, is not called good."""

from __future__ import annotations

from playwright.async_api import Page, expect

from tests.whole.client import attached, make_clock, make_event
from tests.whole.conftest import Starts

PAST = "/rogue publishes /a past the monitor"
UNHEARD = "the publisher /sensor has another type: std_msgs/msg/Int32"


async def test_a_session_that_may_be_wrong_is_neither_fine_nor_good(start: Starts, page: Page) -> None:
    server = start(ORACLE_HISTORY="memory")
    card = page.locator(".now .card")
    async with (
        attached(server, session="passed", spec="bypassed") as passed,
        attached(server, session="unheard", spec="single") as unheard,
        attached(server, session="sound", spec="single") as sound,
    ):
        await passed.send(make_event(1, "/a", data={"v": 1}), make_event(2, "/b", at=1))
        await passed.send(make_clock("/a", at=2), make_clock("/b", at=2))
        await passed.acked(2)
        for monitor in (unheard, sound):
            await monitor.send(make_event(1, data={"v": 1}))
            await monitor.acked(1)
        await page.goto(f"{server.url}/")
        kinds = page.get_by_role("toolbar", name="Kinds")
        await expect(kinds).to_contain_text("Fine 3")
        stream = {"stream": "/a", "kind": "topic"}
        await passed.send({"type": "report", "streams": [{**stream, "trouble": PAST, "bypass": PAST}]})
        await unheard.send({"type": "report", "streams": [{**stream, "trouble": UNHEARD}]})
        await expect(kinds).to_contain_text("Degraded 2")
        await expect(kinds).to_contain_text("Fine 1")
        await expect(page.get_by_role("row", name="passed")).to_contain_text(f"{PAST} since 20")
        await expect(page.get_by_role("row", name="unheard")).to_contain_text(f"/a: {UNHEARD}")

        await page.goto(f"{server.url}/#/sessions/passed")
        await expect(card).to_contain_text("All 3 properties hold; 2 of 3 degraded: a_is_small, b_after_a")
        await expect(card).to_have_attribute("data-state", "degraded")
        values = page.locator(".lane.property .value")
        await expect(values).to_have_text(["✓ degraded", "✔ degraded", "✓"])
        await page.goto(f"{server.url}/#/sessions/unheard")
        await expect(card).to_contain_text("Its property holds; not all streams are heard as they should be")
        await expect(page.locator(".title .complaint")).to_have_text(f"/a: {UNHEARD}")
        await page.goto(f"{server.url}/#/sessions/sound")
        await expect(card).to_have_attribute("data-state", "hold")

        await passed.send({"type": "report", "streams": [{**stream, "trouble": "", "bypass": ""}]})
        await unheard.detach()
        await page.goto(f"{server.url}/")
        await expect(kinds).to_contain_text("Degraded 0")
