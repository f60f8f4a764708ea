"""Every view, in both themes, wide and narrow: axe-core finds nothing grave, and nothing is scrolled sideways."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator
from typing import Any, Literal

import pytest
import pytest_asyncio
from axe_playwright_python.async_playwright import Axe
from playwright.async_api import Browser, Page, expect

from tests.whole.client import attached, make_event, make_events
from tests.whole.harness import PATIENCE, Server

GRAVE = ("serious", "critical")
WIDTHS = {390: 844, 1440: 900}
OPTIONS = {"resultTypes": ["violations"]}


@pytest_asyncio.fixture(loop_scope="session")
async def shown(server: Server, session: str) -> AsyncIterator[dict[str, str]]:
    """The addresses of all views, of a session of thirty properties of which one fails, and what each waits for."""
    async with attached(server, session=session, spec="thirty") as monitor:
        said = [27 if i > 50 else 0 for i in range(1, 61)]
        await monitor.send(make_events(*(make_event(i, at=i * 1000, data={"v": v}) for i, v in enumerate(said, 1))))
        await monitor.acked(60)
        (violation,) = server.records(session, "violations", limit=1)[:1]
        yield {
            "": ".sessions .wrong",
            f"sessions/{session}": ".lane.property",
            f"sessions/{session}?n={violation['n']}": ".verdict:has(.reasons):has(.parts) .diagram",
            f"compare/{session}/{session}": ".compared .first",
            f"compare/{session}": ".compared",
            "specs": "table.specs",
            "specs/thirty": "pre",
            "edit/thirty": "textarea",
        }


def told(violation: dict[str, Any]) -> str:
    """What axe-core has found, with the first elements that it means."""
    nodes = [f"{node['target']} {node['failureSummary']}" for node in violation["nodes"][:3]]
    return f"{violation['id']} ({violation['impact']}): {violation['help']}: {nodes}"


@pytest.mark.parametrize("scheme", ["light", "dark"])
async def test_nothing_is_in_the_way_of_anybody(
    server: Server, shown: dict[str, str], browser: Browser, scheme: Literal["light", "dark"]
) -> None:
    found: list[str] = []
    page = await browser.new_page(color_scheme=scheme)
    page.set_default_timeout(PATIENCE * 1000)
    for address, wanted in shown.items():
        await open_view(page, f"{server.url}/#/{address}", wanted)
        for width, height in WIDTHS.items():
            await page.set_viewport_size({"width": width, "height": height})
            results = (await Axe().run(page, options=OPTIONS)).response
            grave = [told(each) for each in results["violations"] if each["impact"] in GRAVE]
            found += [f"/#/{address} at {width}, {scheme}: {text}" for text in grave]
            across = await page.evaluate("document.documentElement.scrollWidth")
            found += [f"/#/{address} at {width}: it is {across} wide"] if across > width else []
    await page.close()
    assert found == []


async def open_view(page: Page, url: str, wanted: str) -> None:
    await page.goto("about:blank")
    await page.goto(url)
    await expect(page.locator(wanted).first).to_be_visible()


async def test_what_is_told_by_colours_is_seen_where_the_system_has_its_own(
    server: Server, session: str, page: Page
) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, data={"v": 11}) | {"stamp": time.time_ns()})
        await monitor.acked(1)
    await page.emulate_media(forced_colors="active")
    back = "(element) => getComputedStyle(element).backgroundColor"
    await open_view(page, f"{server.url}/#/", ".bars button")
    bar = page.locator(".bars button i").first
    assert await bar.evaluate(back) != await page.locator("body").evaluate(back)
    kinds = page.get_by_role("toolbar", name="Kinds").get_by_role("button")
    assert await kinds.first.evaluate(back) != await kinds.last.evaluate(back), "the first one is pressed"
    colours = """async () => {
      const { colour } = await import("./dashboard/painting.js");
      return ["paper", "bad", "fails", "fails-text", "holds"].map(colour);
    }"""
    assert len(set(await page.evaluate(colours))) >= 4, "the white of paper is that of a text"
