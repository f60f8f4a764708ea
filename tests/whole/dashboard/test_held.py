"""Who held an event up, as somebody in front of a browser is told."""

from __future__ import annotations

from playwright.async_api import Page, expect

from tests.whole.client import attached, make_clock, make_event
from tests.whole.harness import Server


async def test_a_click_tells_who_held_a_command_up(server: Server, session: str, page: Page) -> None:
    async with (
        attached(server, "base", session=session, spec="office", streams=["/cmd", "/chat"]) as base,
        attached(server, "arm", session=session, streams=["/odom"]) as arm,
    ):
        await arm.send(make_event(1, "/odom", at=5, data={"speed": 0}), make_clock("/odom", 6))
        await base.send(make_clock("/chat", 200))
        assert (await base.ask(1, stream="/cmd", at=20, data={"v": 11}, source="/pilot"))["decision"] == "deny"
        await arm.send(make_clock("/odom", 200))
        assert (await base.ask(2, stream="/cmd", at=90, data={"v": 1}, source="/pilot"))["decision"] == "allow"
        await base.acked(2)
    await page.goto(f"{server.url}/#/sessions/{session}")
    await page.locator(".now a.card").click()
    held = page.locator(".verdict p.held")
    await expect(held).to_contain_text("Held up")
    await expect(held).to_contain_text("waited for /odom of arm, in vain: `max_delay` was over")
    denied = page.locator(".diagram a.denied")
    await expect(denied.locator("title")).to_contain_text("by /odom of arm")
    lane = page.locator(".lane.stream", has=page.get_by_role("button", name="/odom"))
    await expect(lane.locator(".value")).to_contain_text("waited for")
    await expect(page.locator(".lane.stream .value", has_text="waited for")).to_have_count(1)
    await page.locator(".diagram a.allowed").click()
    await expect(page.locator(".verdict h3")).to_contain_text("step 3")
    await expect(held).to_have_count(0)
    await expect(page.locator(".lane.stream .value", has_text="waited for")).to_have_count(0)
