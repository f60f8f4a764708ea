"""A spec with many properties that all fail, and long names: all are counted, and the page is no wider than a phone."""

from __future__ import annotations

from playwright.async_api import Page, expect

from tests.whole.client import attached, make_event
from tests.whole.conftest import Starts

PROPERTIES = 60
LONG = "n" * 60
TOPIC = f"/{'/'.join([LONG] * 3)}"


async def test_all_that_fail_are_counted_and_long_names_are_broken(start: Starts, page: Page) -> None:
    server = start(ORACLE_HISTORY="memory")
    properties = "".join(f"  - {{id: p{i}_{LONG}, formula: 'not {{{LONG} > 10}}'}}\n" for i in range(PROPERTIES))
    spec = f"id: many\nstreams:\n  - {{topic: {TOPIC}, signals: {{{LONG}: msg.v}}}}\nproperties:\n{properties}"
    assert server.http.put("/api/v1/specs/many", content=spec).status_code < 300
    async with attached(server, monitor=LONG, session="s", spec="many") as monitor:
        await monitor.send(make_event(1, TOPIC, data={"v": 11}))
        await monitor.acked(1)
        assert len(server.get("sessions/s/episodes", open=True, limit=1000)["items"]) == PROPERTIES
        await page.set_viewport_size({"width": 390, "height": 844})
        await page.goto(f"{server.url}/#/sessions/s?n=1")
        await expect(page.locator(".facts")).to_contain_text(f"{PROPERTIES} open episodes")
        await expect(page.locator(".verdict dt", has_text=LONG).first).to_be_attached()
        assert await page.evaluate("document.documentElement.scrollWidth <= innerWidth")


async def test_a_course_in_time_that_is_too_large_is_asked_for_in_fewer_buckets(start: Starts, page: Page) -> None:
    server = start(ORACLE_HISTORY="memory")
    properties = "".join(f"  - {{id: p{i:03}, formula: 'not {{v > {i + 10}}}'}}\n" for i in range(400))
    spec = f"id: wide\nstreams:\n  - {{topic: /a, signals: {{v: msg.v}}}}\nproperties:\n{properties}"
    assert server.http.put("/api/v1/specs/wide", content=spec).status_code < 300
    async with attached(server, session="s", spec="wide") as monitor:
        await monitor.send(*(make_event(i, at=100 * i, data={"v": 11 if i > 590 else 1}) for i in range(1, 601)))
        await monitor.acked(600)
        await page.set_viewport_size({"width": 1920, "height": 1000})
        await page.goto(f"{server.url}/#/sessions/s")
        for act in (None, "0"):  # live, and all of it
            if act:
                await page.locator(".plots").press(act)
            await expect(page.locator(".now .card.open")).to_contain_text("p000 fails")
            await expect(page.locator(".lane.property").first.locator(".value")).to_have_text("✗ for 900 ms")
            await expect(page.get_by_role("status")).to_have_text("connected")


async def test_a_session_whose_episode_is_beyond_those_that_are_listed_fails_all_the_same(
    start: Starts, page: Page
) -> None:
    """The list asks for a thousand open episodes: of what was beyond it said `1 violation before`."""
    server = start(ORACLE_HISTORY="memory")
    properties = "".join(f"  - {{id: p{i:03}, formula: 'not {{v > {i}}}'}}\n" for i in range(500))
    spec = f"id: wide\nstreams:\n  - {{topic: /a, signals: {{v: msg.v}}}}\nproperties:\n{properties}"
    assert server.http.put("/api/v1/specs/wide", content=spec).status_code < 300
    for at, (name, id_, value) in enumerate([("one", "wide", 999), ("two", "wide", 999), ("last", "single", 99)]):
        async with attached(server, session=name, spec=id_) as monitor:
            await monitor.send(make_event(1, at=at, data={"v": value}))
            await monitor.acked(1)
    assert len(server.get("episodes", open=True, limit=1000)["items"]) == 1000
    await page.goto(server.url)
    await expect(page.locator(".sessions tr.group").first).to_have_text("Wrong now")
    row = page.get_by_role("row", name="last")
    await expect(row.locator("td:nth-child(2)")).to_have_text("fails")
    await expect(page.get_by_role("row", name="one").locator("td:nth-child(2)")).to_contain_text("p000")
