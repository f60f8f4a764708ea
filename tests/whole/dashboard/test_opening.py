"""While a session's page opens, no button moves: one that moves between press and release is not clicked."""

from __future__ import annotations

import pytest
from playwright.async_api import Page, expect

from tests.whole.client import attached, make_event
from tests.whole.dashboard.test_troubles import Held
from tests.whole.harness import Server

PATIENT = """
const later = setTimeout;
setTimeout = (act, ms, ...more) => later(act, ms === 5000 ? 1e9 : ms, ...more);
AbortSignal.timeout = () => new AbortController().signal;
"""
"""The page takes no server for slow, however long it answers nothing."""
QUICK = "const later = setTimeout; setTimeout = (act, ms, ...more) => later(act, ms === 5000 ? 100 : ms, ...more);"
"""It takes one for slow soon."""
WIDE, PHONE = (1280, 800), (390, 844)


@pytest.mark.parametrize("size", [WIDE, PHONE])
async def test_buttons_are_shown_once_what_stands_above_them_is(
    server: Server, session: str, page: Page, size: tuple[int, int]
) -> None:
    """What is wrong now came above the toolbar, which moved by up to 240 pixels: who pressed All, pressed nothing."""
    await page.set_viewport_size({"width": size[0], "height": size[1]})
    await page.add_init_script(PATIENT)
    async with attached(server, session=session, spec="thirty") as monitor:
        await monitor.send(make_event(1, at=1, data={"v": 1}), make_event(2, at=60_000, data={"v": 2}))
        await monitor.acked(2)
        held = Held()
        await page.route("**/verdicts?**", held)  # which the cards wait for
        await page.goto(f"{server.url}/#/sessions/{session}")
        await expect(page.locator(".head .chip.bad")).to_be_visible()
        button = page.locator(".time").get_by_role("button", name="All", exact=True, include_hidden=True)
        await expect(button).to_be_attached()
        await expect(button).to_be_hidden()
        header = await page.locator("header").bounding_box()
        held.open.set()
        await expect(button).to_be_visible()
        there = await button.bounding_box()
        await expect(page.locator(".head .waiting")).to_contain_text("newest step")
        await expect(page.locator(".now .card.open").first).to_be_visible()
        await expect(page.locator(".chart .violation").first).to_be_attached()
        await expect(page.get_by_role("status")).to_have_text("connected")
        assert await button.bounding_box() == there
        assert await page.locator("header").bounding_box() == header


async def test_what_there_is_is_shown_where_the_rest_takes_long(server: Server, session: str, page: Page) -> None:
    await page.add_init_script(QUICK)
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, at=1, data={"v": 1}))
        await monitor.acked(1)
        held = Held()
        await page.route("**/timeline?**", held)
        await page.goto(f"{server.url}/#/sessions/{session}")
        await expect(page.get_by_role("status")).to_contain_text("The server is slow")
        await expect(page.locator(".properties")).to_contain_text("a_is_small")
        await expect(page.locator(".properties tbody")).to_be_visible()
        held.open.set()
        await expect(page.locator(".now .card")).to_be_visible()
