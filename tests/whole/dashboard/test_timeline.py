"""The session by time, as somebody in front of a browser sees and moves it."""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncIterator

import pytest
import pytest_asyncio
from playwright.async_api import Page, Route, expect

from tests.whole.client import BASE, Monitor, attached, make_event
from tests.whole.dashboard.focus import focus
from tests.whole.harness import Server

SMALL, BIG = {"v": 1}, {"v": 11}
SECOND = 1000
PIXEL = """([canvas, share, name]) => {
  const at = [Math.round(share * canvas.width), Math.round(canvas.height / 2)];
  const probe = document.body.appendChild(document.createElement("i"));
  probe.style.color = `var(--${name})`;
  const wanted = getComputedStyle(probe).color;
  probe.remove();
  const [r, g, b, a] = canvas.getContext("2d").getImageData(...at, 1, 1).data;
  return a === 255 && wanted === `rgb(${r}, ${g}, ${b})`;
}"""


@pytest_asyncio.fixture(loop_scope="session")
async def monitor(server: Server, session: str, page: Page) -> AsyncIterator[Monitor]:
    """A minute with an event a second, of which those from 20 s to 29 s are violations; and the page of it."""
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(*(at_second(i) for i in range(1, 61)))
        await monitor.acked(60)
        await page.goto(f"{server.url}/#/sessions/{session}")
        await expect(page.locator(".lane.property")).to_have_count(1)
        yield monitor


def at_second(number: int) -> dict[str, object]:
    return make_event(number, at=number * SECOND, data=BIG if 20 <= number < 30 else SMALL)


async def painted(page: Page, share: float, name: str, lane: str = ".lane.property") -> None:
    """Wait until the middle of a lane has a colour at a share of its width."""
    canvas = await page.locator(f"{lane} canvas").first.element_handle()
    await page.wait_for_function(PIXEL, arg=[canvas, share, name])


async def shown(page: Page) -> str:
    return await page.locator(".time .tools .hint").inner_text()


async def test_what_failed_is_seen_where_it_did(page: Page, monitor: Monitor) -> None:
    await page.locator(".time").get_by_role("button", name="All", exact=True).click()
    for share, name in [(0.1, "holds"), (0.4, "fails-soft"), (0.9, "holds")]:
        await painted(page, share, name)
    await expect(page.locator(".lane.stream")).to_contain_text("/a")
    await expect(page.locator(".lane.stream .value")).to_have_text("1.0 Hz")
    await monitor.send(at_second(61))
    await expect(page.locator(".lane.property .value")).to_have_text("✓ 1 violation")


@pytest.mark.usefixtures("monitor")
async def test_all_that_is_asked_for_before_it_is_known_is_all_of_it(server: Server, session: str, page: Page) -> None:
    told = asyncio.Event()

    async def hold(route: Route) -> None:
        await told.wait()
        await route.continue_()

    await page.goto(f"{server.url}/#/")
    await page.route("**/timeline?**", hold)
    await page.goto(f"{server.url}/#/sessions/{session}")
    await page.locator(".time").get_by_role("button", name="All", exact=True).click()
    told.set()
    await expect(page.locator(".time .shown")).to_have_text(re.compile(r"00:01\.000 to .*01:00\.000, UTC"))


async def test_a_click_explains_what_was_there(page: Page, monitor: Monitor) -> None:
    await page.locator(".time").get_by_role("button", name="All", exact=True).click()
    await painted(page, 0.4, "fails-soft")
    canvas = page.locator(".lane.property canvas")
    box = await canvas.bounding_box()
    assert box is not None
    await canvas.click(position={"x": 0.42 * box["width"], "y": box["height"] / 2})
    heading = page.locator(".verdict").get_by_role("heading")
    await expect(heading).to_contain_text(re.compile("a_is_small ✗ currently_false at step 2[5-6], "))
    await expect(page.locator(".cursor")).to_be_visible()
    await page.get_by_role("link", name="Follow the newest steps").click()
    await expect(page.locator(".cursor")).to_be_hidden()


async def test_a_click_on_what_fails_explains_the_violation_there(page: Page, monitor: Monitor) -> None:
    """Beside each violation there may be many steps that are none, a pixel wide together."""
    await monitor.send(*(make_event(60 + i, at=61 * SECOND + i, data=BIG if i == 20 else SMALL) for i in range(1, 100)))
    await monitor.acked(159)
    await expect(page.locator(".lane.property .value")).to_have_text("✓ 2 violations")
    await page.locator(".time").get_by_role("button", name="All", exact=True).click()
    canvas = page.locator(".lane.property canvas")
    box = await canvas.bounding_box()
    assert box is not None
    await painted(page, 0.9, "holds")
    await canvas.click(position={"x": box["width"] - 2, "y": box["height"] / 2})
    heading = page.locator(".verdict").get_by_role("heading")
    await expect(heading).to_contain_text("a_is_small ✗ currently_false at step 80, ")


async def test_it_is_moved_by_keys_alone(page: Page, monitor: Monitor) -> None:
    plots = page.locator(".plots")
    live = page.locator(".time").get_by_role("button", name=re.compile("live", re.IGNORECASE))
    await expect(live).to_have_attribute("aria-pressed", "true")
    await focus(plots)
    await page.keyboard.press("0")
    await expect(live).to_have_text("Go live")
    whole = await shown(page)
    await painted(page, 0.4, "fails-soft")
    await page.keyboard.press("+")
    await page.keyboard.press("+")
    await expect(page.locator(".time .tools .hint")).not_to_have_text(whole)
    await painted(page, 0.1, "fails-soft")
    for _ in range(2):
        await page.keyboard.press("ArrowLeft")
    await painted(page, 0.1, "holds")
    await painted(page, 0.6, "fails-soft")
    await page.keyboard.press("l")
    await expect(live).to_have_attribute("aria-pressed", "true")
    before = await shown(page)
    await monitor.send(at_second(61))
    await expect(page.locator(".time .tools .hint")).not_to_have_text(before)


async def test_it_is_dragged_and_zoomed_at_the_pointer(page: Page, monitor: Monitor) -> None:
    await page.locator(".time").get_by_role("button", name="All", exact=True).click()
    await painted(page, 0.4, "fails-soft")
    box = await page.locator(".lane.property canvas").bounding_box()
    assert box is not None
    x, y, width = box["x"], box["y"] + box["height"] / 2, box["width"]
    await page.mouse.move(x + 0.4 * width, y)
    await page.mouse.down()
    await page.mouse.move(x + 0.1 * width, y, steps=4)
    await page.mouse.up()
    await painted(page, 0.1, "fails-soft")
    await painted(page, 0.4, "holds")
    await expect(page.locator(".verdict")).to_be_empty()
    await page.keyboard.down("Control")
    await page.mouse.move(x + 0.1 * width, y)
    await page.mouse.wheel(0, -400)
    await page.keyboard.up("Control")
    await painted(page, 0.4, "fails-soft")
    await painted(page, 0.1, "fails-soft")


async def test_what_has_no_steps_has_an_empty_timeline(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await page.goto(f"{server.url}/#/sessions/{session}")
        await expect(page.get_by_role("status")).to_have_text("connected")
        await expect(page.locator(".lane.property")).to_have_count(0)
        await monitor.send(at_second(1))
        await expect(page.locator(".lane.property")).to_have_count(1)


async def test_an_address_of_a_verdict_shows_the_time_of_it(page: Page, monitor: Monitor) -> None:
    base = page.url
    await monitor.send(*(at_second(i) for i in range(61, 400)))
    await monitor.acked(399)
    await page.goto("about:blank")
    await page.goto(f"{base}?n=25")
    await expect(page.locator(".verdict").get_by_role("heading")).to_contain_text("currently_false at step 25")
    await expect(page.locator(".cursor")).to_be_visible()
    await painted(page, 0.508, "fails-soft")


async def test_what_stands_beside_a_row_is_of_what_is_in_view(server: Server, session: str, page: Page) -> None:
    """More is asked for than is in view, so that something is there when it is moved."""
    async with attached(server, session=session, spec="single") as monitor:
        seconds = (1, 50, 58, 61, 70.5, 72, 120)
        await monitor.send(*(make_event(i, at=at * SECOND, data=SMALL) for i, at in enumerate(seconds, 1)))
        await monitor.acked(len(seconds))
    since, until = (BASE + at * 10**9 for at in (60, 70))
    await page.goto(f"{server.url}/#/sessions/{session}?from={since}&to={until}")
    await expect(page.locator(".lane.stream .value")).to_have_text("1 in view")
