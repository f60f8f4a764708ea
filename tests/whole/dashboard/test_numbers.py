"""Numbers that few robots tell, and that are shown as they are all the same."""

from __future__ import annotations

import re

from playwright.async_api import Page, expect

from tests.whole.client import attached, make_event, make_events
from tests.whole.harness import Server

REACHES = """(canvas) => {
  const probe = document.body.appendChild(document.createElement("i"));
  probe.style.color = "var(--accent)";
  const wanted = getComputedStyle(probe).color.match(/\\d+/g).map(Number);
  probe.remove();
  const { width, height } = canvas;
  const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
  const near = (at) => data[at + 3] > 128 && wanted.every((each, i) => Math.abs(data[at + i] - each) < 40);
  const rows = [...Array(height).keys()].filter((y) => [...Array(width).keys()].some((x) => near(4 * (y * width + x))));
  return rows.length > 0 && rows[0] < 0.25 * height && rows.at(-1) > 0.75 * height;
}"""


async def test_a_plot_reaches_from_the_least_number_to_the_largest(server: Server, session: str, page: Page) -> None:
    """The distance of both is infinite: all of it was drawn at the bottom."""
    events = (make_event(i, at=1000 * i, data={"v": -1.7e308 if i < 10 else 1.7e308}) for i in range(1, 21))
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_events(*events))
        await monitor.acked(20)
        await page.goto(f"{server.url}/#/sessions/{session}")
        canvas = await page.locator(".lane.signal canvas").element_handle()
        await page.wait_for_function(REACHES, arg=canvas)


async def test_a_number_of_many_digits_is_not_cut_off(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, at=1000, data={"v": 2**60}))
        await monitor.acked(1)
        await page.goto(f"{server.url}/#/sessions/{session}")
        await expect(page.locator(".lane.signal .value")).to_have_text("1.153e+18")


async def test_of_numbers_that_are_drawn_as_one_point_the_least_and_the_greatest_are_told(
    server: Server, session: str, page: Page
) -> None:
    """Their mean was: of a battery that had just come to 3 it said 1.5."""
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_events(*(make_event(i, at=1000, data={"v": v}) for i, v in enumerate((1, 0.5, 3), 1))))
        await monitor.acked(3)
        await page.goto(f"{server.url}/#/sessions/{session}")
        await expect(page.locator(".lane.signal .value")).to_have_text("0.5 to 3")


async def test_a_stream_that_speaks_seldom_is_not_told_as_silent(server: Server, session: str, page: Page) -> None:
    """One message in 30 s was 0.0 Hz."""
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_events(*(make_event(i, at=i * 30_000, data={"v": 1}) for i in range(1, 121))))
        await monitor.acked(120)
        await page.goto(f"{server.url}/#/sessions/{session}")
        await page.locator(".time").get_by_role("button", name="All", exact=True).click()
        await expect(page.locator(".lane.stream .value")).to_have_text(re.compile(r"^every (29|30)\.\d s$"))
