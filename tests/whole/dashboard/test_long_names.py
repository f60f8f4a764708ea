"""Names of 64 letters, which are told apart by their ends."""

from __future__ import annotations

import pytest
from playwright.async_api import Page, expect

from tests.whole.client import attached, make_event
from tests.whole.harness import Server

WIDE, PHONE = (1280, 800), (390, 844)
NAMES = [f"{'a_property_with_a_long_name_'}{'x' * 33}_{i:02}" for i in range(3)]


@pytest.mark.parametrize("size", [WIDE, PHONE])
async def test_long_names_are_read_to_their_ends(
    server: Server, session: str, page: Page, size: tuple[int, int]
) -> None:
    await page.set_viewport_size({"width": size[0], "height": size[1]})
    assert {len(name) for name in NAMES} == {64}
    properties = "\n".join(
        f"  - {{id: {name}, formula: 'not {{topic: \"/a\", v > {i}}}'}}" for i, name in enumerate(NAMES)
    )
    text = f"id: {session}\nstreams: [{{topic: /a, signals: {{v: msg.v}}}}]\nproperties:\n{properties}\n"
    server.http.put(f"/api/v1/specs/{session}", content=text).raise_for_status()
    long = f"{session}-{'x' * 80}"[:64]
    async with attached(server, session=long, spec=session) as monitor:
        await monitor.send(make_event(1, at=1, data={"v": 0}), make_event(2, at=2, data={"v": 9}))
        await monitor.acked(2)
        await page.goto(f"{server.url}/#/sessions/{long}")
        labels = page.locator(".lane.property .label button")
        await expect(labels).to_have_text(NAMES)
        await expect(page.locator(".episodes tbody tr")).to_have_count(3)
        ends = labels.locator(".named > :last-child")
        assert [(await end.text_content() or "")[-2:] for end in await ends.all()] == ["00", "01", "02"]
        for label, end in zip(await labels.all(), await ends.all(), strict=True):
            outer, inner = await label.bounding_box(), await end.bounding_box()
            assert outer is not None
            assert inner is not None
            assert inner["x"] + inner["width"] <= outer["x"] + outer["width"] + 1
        steps = page.locator(".chart tbody th").filter(has_text="a_property")
        await expect(steps).to_have_text(NAMES, use_inner_text=True)  # they can be copied
        assert await steps.first.evaluate("cell => cell.scrollWidth <= cell.clientWidth")
        episodes = page.locator(".details .episodes")
        assert await episodes.locator("td:first-child").first.evaluate("cell => cell.scrollWidth <= cell.clientWidth")
        await page.goto(f"{server.url}/#/compare/{long}/{long}")
        await expect(page.locator("table.compared")).to_be_visible()
        assert await page.locator("section.compared").evaluate("box => box.scrollWidth <= box.clientWidth"), (
            "none is cut off"
        )
        await page.goto(f"{server.url}/#/?q={long}")
        row = page.locator(".sessions tbody tr.wrong")
        await expect(row).to_have_count(1)
        for cell in (row.locator("td").nth(0), row.locator("td").nth(1)):
            box = await cell.locator("a").first.bounding_box()
            assert box is not None
            assert box["width"] < 360
            assert await cell.evaluate("cell => cell.scrollWidth <= cell.clientWidth"), "nothing is cut off"
