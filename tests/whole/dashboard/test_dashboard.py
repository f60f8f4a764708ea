"""The dashboard, as somebody in front of a browser sees it."""

from __future__ import annotations

import re

from playwright.async_api import Page, expect

from tests.whole.client import attached, make_event
from tests.whole.dashboard.focus import focus
from tests.whole.harness import Server

SMALL, BIG = {"v": 1}, {"v": 11}


async def test_a_session_is_seen_as_it_goes_on(server: Server, session: str, page: Page) -> None:
    await page.goto(f"{server.url}/")
    await expect(page.get_by_role("status")).to_have_text("connected")
    async with attached(server, session=session, spec="single") as monitor:
        row = page.get_by_role("row").filter(has=page.get_by_role("link", name=session, exact=True))
        await expect(row).to_contain_text("1 of 1")
        await monitor.send(make_event(1, at=1, data=SMALL))
        await expect(row).to_contain_text("currently_true")
        await row.get_by_role("link", name=session, exact=True).click()
        await expect(page.get_by_role("heading", level=1)).to_have_text(session)
        await expect(page.get_by_role("link", name="a_is_small at step 1: currently_true")).to_be_visible()
        await monitor.send(make_event(2, at=2, data=BIG), make_event(3, at=3, data=SMALL))
        await expect(page.get_by_role("link", name="a_is_small at step 2: currently_false")).to_be_visible()
        await expect(page.get_by_role("link", name="a_is_small at step 3: currently_true")).to_be_visible()
        await expect(page.locator(".violations li")).to_have_count(1)
        await monitor.detach()
    await expect(page.locator(".monitors")).to_contain_text("detached")
    server.http.delete(f"/api/v1/sessions/{session}")
    await expect(page.locator("strong.closed")).to_be_visible()


async def test_an_address_whose_number_is_none_shows_the_newest_steps(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, at=1, data=SMALL))
        await monitor.acked(1)
    for number in ("-1", "1.5", "1e3", "x", "0", "9" * 30):
        await page.goto("about:blank")
        await page.goto(f"{server.url}/#/sessions/{session}?n={number}")
        await expect(page.get_by_role("link", name="a_is_small at step 1: currently_true")).to_be_visible()
        await expect(page.locator("main")).not_to_contain_text("query.")
        await expect(page.locator(".verdict")).to_be_empty()


async def test_any_verdict_says_why_it_is_so(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, at=1, data=SMALL), make_event(2, at=2, data=BIG))
        await monitor.acked(2)
    (violation,) = server.records(session, "violations")
    await page.goto(f"{server.url}/#/sessions/{session}")
    await page.locator(".violations a").click()
    verdict = page.locator(".verdict")
    reason = violation["explanation"]["reasons"][0]
    await expect(verdict.get_by_role("heading")).to_contain_text("a_is_small ✗ currently_false at step 2, ")
    await expect(verdict.locator(".reasons")).to_contain_text("with v = 11")
    await expect(verdict.locator(".reasons > li").first).to_contain_text(f"{reason['formula']} {reason['text']}")
    await expect(page.locator("td.witness")).to_have_attribute("title", re.compile("^step 2: /a "))
    await page.reload()
    await expect(verdict.get_by_role("heading")).to_contain_text("currently_false")
    assert page.url.endswith(f"#/sessions/{session}?n={violation['n']}")
    await page.get_by_role("link", name="a_is_small at step 1: currently_true").click()
    await expect(verdict.get_by_role("heading")).to_contain_text("✓ currently_true")
    await expect(verdict.locator(".reasons > li").first).to_be_visible()
    await page.get_by_role("link", name="Follow the newest steps").click()
    await expect(verdict).to_be_empty()


async def test_a_long_session_is_walked_through(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(*(make_event(i, at=i, data=SMALL if i != 20 else BIG) for i in range(1, 201)))
        await monitor.acked(200)
    cells = page.locator(".chart td > a")
    await page.goto(f"{server.url}/#/sessions/{session}")
    await expect(cells).to_have_count(60)
    await expect(cells.last).to_have_attribute("aria-label", "a_is_small at step 200: currently_true")
    await page.locator(".violations a").click()
    await expect(cells.first).to_have_attribute("aria-label", re.compile("at step 1:"))
    await expect(page.locator(".chosen")).to_have_attribute("aria-label", re.compile("at step 20:"))
    steps = [20]
    while await page.get_by_role("link", name="Later").count():
        await page.get_by_role("link", name="Later").click()
        chosen = page.locator(f".chosen:not([aria-label*='step {steps[-1]}:'])")
        label = await chosen.get_attribute("aria-label") or ""
        steps.append(int(label.split("step ")[1].split(":")[0]))
        await expect(page.locator(".verdict h3")).to_have_text(re.compile(f" at step {steps[-1]}, "))
    assert steps == sorted(steps)
    assert steps[-1] == 200
    await page.get_by_role("link", name="Earlier").click()
    await expect(page.locator(".chosen")).to_have_attribute("aria-label", re.compile("at step 170:"))


async def test_simulated_time_is_told_in_seconds(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="single", clock="sim") as monitor:
        await monitor.send({"type": "clock", "stamps": [{"stream": "/a", "kind": "topic", "stamp": 2 * 10**9}]})
        await monitor.send({**make_event(1, data=BIG), "stamp": 15 * 10**8})
        await monitor.acked(1)
    (record,) = server.records(session)
    await page.goto(f"{server.url}/#/sessions/{session}?n=1")
    arrived = f"{record['arrived'] / 10**9:.3f} s"
    await expect(page.locator(".verdict")).to_contain_text(f"published 1.500 s · arrived {arrived} · judged ")
    await expect(page.locator(".verdict")).not_to_contain_text("later")
    await expect(page).to_have_title(f"{session} – oracle-server")  # noqa: RUF001
    await page.get_by_role("link", name="Sessions").click()
    await expect(page).to_have_title("oracle-server")


async def test_older_violations_are_asked_for(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(*(make_event(i, at=i, data=BIG if i % 2 else SMALL) for i in range(1, 51)))
        await monitor.acked(50)
    listed = page.locator(".violations li")
    await page.goto(f"{server.url}/#/sessions/{session}")
    await expect(listed).to_have_count(20)
    await expect(listed.first).to_contain_text("at step 49")
    await page.get_by_role("button", name="Older ones").click()
    await expect(listed).to_have_count(25)
    await expect(page.get_by_role("button", name="Older ones")).to_have_count(0)


async def test_a_verdict_that_is_not_there_yet_is_shown_once_it_is(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await page.goto(f"{server.url}/#/sessions/{session}?n=1")
        await expect(page.locator(".verdict")).to_contain_text("has no verdict 1 in its history yet")
        await monitor.send(make_event(1, at=1, data=BIG))
        await expect(page.locator(".verdict")).to_contain_text("currently_false")


async def test_both_orders_are_shown_one_at_a_time(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="both", streams=["/a", "/b"]) as monitor:
        await monitor.send(make_event(1, "/b", at=2), make_event(2, "/a", at=1), make_event(3, "/b", at=3))
        await monitor.send(make_event(4, "/a", at=4))
        await monitor.detach()
    await page.goto(f"{server.url}/#/sessions/{session}")
    chart = page.locator(".chart")
    await expect(page.locator(".properties")).to_contain_text("b_after_a by arrival")
    await expect(page.get_by_text("The orders disagree on b_after_a.")).to_be_visible()
    await expect(chart.locator(".false, .currently_false")).to_have_count(0)
    await page.get_by_role("button", name="by arrival").click()
    await expect(chart.get_by_role("link", name="b_after_a at step 1: currently_false")).to_be_visible()
    first = page.locator(".properties").get_by_role("link")
    await first.click()
    await expect(page.locator(".chosen")).to_have_attribute("aria-label", "b_after_a at step 1: currently_false")
    await expect(page.get_by_role("button", name="by arrival")).to_have_attribute("aria-pressed", "true")


async def test_a_spec_is_shown_with_its_text(server: Server, page: Page) -> None:
    await page.goto(f"{server.url}/")
    await page.get_by_role("link", name="Specs").click()
    await page.get_by_role("link", name="lamp", exact=True).click()
    await expect(page.locator("pre")).to_contain_text("id: lamp")
    await expect(page.locator("table.streams")).to_contain_text("/switch requests")


async def test_a_small_screen_shows_all_of_it(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="lamp", streams=["/light"]) as monitor:
        await monitor.send(*(make_event(i, "/light", at=i, data={"level": 3}) for i in range(1, 90)))
        await monitor.detach()
    await page.set_viewport_size({"width": 360, "height": 640})
    await page.goto(f"{server.url}/#/sessions/{session}")
    await expect(page.locator(".chart td > a").first).to_be_attached()
    assert await page.evaluate("document.documentElement.scrollWidth") <= 360


async def test_a_number_beyond_the_end_is_told_with_the_last_one(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, at=1, data=SMALL), make_event(2, at=2, data=BIG))
        await monitor.acked(2)
        await monitor.detach()
    await page.goto(f"{server.url}/#/sessions/{session}?n=4000")
    verdict = page.locator(".verdict")
    await expect(verdict).to_contain_text("has no verdict 4000 in its history yet. The last one is verdict 2.")
    await expect(page.locator(".chart")).to_contain_text("no steps around verdict 4000")
    await verdict.get_by_role("link", name="verdict 2").click()
    await expect(verdict.get_by_role("heading")).to_contain_text("currently_false at step 2")


async def test_the_page_is_walked_with_few_stops(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="pair", streams=["/a"]) as monitor:
        await monitor.send(*(make_event(i, "/a", at=i, data=SMALL) for i in range(1, 41)))
        await monitor.detach()
    await page.goto(f"{server.url}/#/sessions/{session}")
    cells = page.locator(".chart td > a")
    await expect(cells.first).to_be_visible()
    await expect(page.locator(".chart td > a[tabindex='0']")).to_have_count(1)
    await page.keyboard.press("Tab")
    await expect(page.get_by_role("link", name="Skip to the content")).to_be_focused()
    await page.keyboard.press("Enter")
    await expect(page.locator("main")).to_be_focused()
    assert page.url.endswith(f"#/sessions/{session}"), "what is shown stays"
    last = page.locator(".chart td > a[tabindex='0']")
    await focus(last)
    label = await last.get_attribute("aria-label") or ""
    assert " at step 40:" in label
    await page.keyboard.press("ArrowLeft")
    focused = page.locator("a:focus")
    await expect(focused).to_have_attribute("aria-label", label.replace("step 40", "step 39"))
    await page.keyboard.press("ArrowDown")
    await expect(focused).to_have_attribute("aria-label", re.compile(" at step 39:"))
    assert (await focused.get_attribute("aria-label") or "").split(" ")[0] != label.split(" ")[0]
    await expect(page.locator(".chart td > a[tabindex='0']")).to_have_count(1)
    await page.keyboard.press("Enter")
    await expect(page.locator(".chosen")).to_have_attribute("aria-label", re.compile(" at step 39:"))


async def test_who_watches_and_since_when_nobody_does_is_shown(server: Server, session: str, page: Page) -> None:
    await page.goto(f"{server.url}/")
    row = page.get_by_role("row").filter(has=page.get_by_role("link", name=session, exact=True))
    async with attached(server, session=session, spec="single") as monitor:
        await expect(row).to_contain_text("live")
        await monitor.detach()
    await expect(row).to_contain_text("open, no monitor since ")
    server.http.delete(f"/api/v1/sessions/{session}")
    await expect(row).to_contain_text("closed")
    await row.get_by_role("link", name=session, exact=True).click()
    await expect(page.locator("strong.closed")).to_be_visible()
    await expect(page.get_by_text("(by request)")).to_be_visible()


async def test_sessions_that_fail_come_first_and_others_are_found_by_their_names(server: Server, page: Page) -> None:
    for name, data in (("calm-1-mood", SMALL), ("rough-mood", BIG), ("calm-2-mood", SMALL)):
        async with attached(server, session=name, spec="single") as monitor:
            await monitor.send(make_event(1, at=1, data=data))
            await monitor.acked(1)
    names = page.locator(".sessions td:first-child a")
    await page.goto(f"{server.url}/")
    await page.get_by_role("searchbox").fill("mood")  # other tests have sessions that fail, too
    await expect(names).to_have_count(3)
    await expect(names.first).to_have_text("rough-mood")
    await page.get_by_role("searchbox").fill("CALM")
    await expect(names).to_have_count(2)
    await page.get_by_role("button", name="Wrong now").click()
    await expect(page.get_by_text(re.compile(r"None of \d+ is like that\."))).to_be_visible()
    await page.get_by_role("searchbox").fill("mood")
    await expect(names.first).to_have_text("rough-mood")
    for name in ("calm-1-mood", "rough-mood", "calm-2-mood"):
        server.http.delete(f"/api/v1/sessions/{name}")
