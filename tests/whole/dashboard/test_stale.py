"""What a page shows is of some time: it says so where that is not now, and shows nothing of what it has not loaded."""

from __future__ import annotations

import json
import re
import time

from playwright.async_api import Page, Route, expect

from tests.whole.client import attached, make_event, make_events
from tests.whole.dashboard.test_timeline import PIXEL, painted
from tests.whole.dashboard.test_troubles import Held
from tests.whole.harness import Server

SECOND = 1000
GOOD, BAD = {"v": 1}, {"v": 11}
QUICK = "const later = setTimeout; setTimeout = (act, ms, ...more) => later(act, ms >= 5000 ? 500 : ms, ...more);"
"""Shortens the time after which the page takes the server for slow."""
UNREADY = "the timeline is made; ask again later"


async def test_what_the_server_does_not_tell_any_more_is_neither_good_nor_bad(
    server: Server, session: str, page: Page
) -> None:
    await page.set_viewport_size({"width": 390, "height": 844})
    async with attached(server, session=session, spec="thirty") as monitor:
        await monitor.send(make_event(1, at=1, data={"v": 0}))
        await monitor.acked(1)
        await page.goto(f"{server.url}/#/sessions/{session}")
        card = page.locator(".now .card")
        await expect(card).to_contain_text("All 30 properties hold")
        status = page.get_by_role("status")
        await expect(status).to_have_text("connected")
        await page.route("**/api/v1/**", lambda route: route.abort())
        await expect(status).to_have_text(
            re.compile(r"The server can't be reached; trying again\. What is shown is of .*\d\d:\d\d:\d\d\.$")
        )
        await page.locator(".violations, .details h2").last.scroll_into_view_if_needed()
        await expect(status).to_be_in_viewport()
        await expect(page.locator(".now")).to_have_css("filter", "grayscale(1)")
        await page.unroute("**/api/v1/**")
        await expect(status).to_have_text("connected")
        await expect(page.locator(".now")).to_have_css("filter", "none")


async def test_a_page_that_waits_for_long_says_of_when_it_is(server: Server, session: str, page: Page) -> None:
    held = Held()
    await page.add_init_script(QUICK)
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, at=1, data=GOOD))
        await monitor.acked(1)
        await page.goto(f"{server.url}/#/sessions/{session}")
        await expect(page.locator(".now .card")).to_contain_text("Its property holds")
        path = f"**/api/v1/sessions/{session}"
        await page.route(path, held)
        await monitor.send(make_event(2, at=2, data=BAD))
        await monitor.acked(2)
        await expect(page.get_by_role("status")).to_contain_text(
            "The server is slow; waiting for it. What is shown is of "
        )
        held.open.set()
        await expect(page.get_by_role("status")).to_have_text("connected")
        await expect(page.locator(".now .card.open")).to_be_visible()


async def test_what_is_wrong_is_told_where_there_is_no_timeline(server: Server, session: str, page: Page) -> None:
    async def refuse(route: Route) -> None:
        await route.fulfill(
            status=503, content_type="application/problem+json", body=json.dumps({"status": 503, "detail": UNREADY})
        )

    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, at=1, data=GOOD))
        await monitor.acked(1)
        await page.goto(f"{server.url}/#/sessions/{session}")
        await expect(page.locator(".now .card")).to_contain_text("Its property holds")
        await page.route("**/timeline?**", refuse)
        await monitor.send(make_event(2, at=2 * SECOND, data=BAD))
        await monitor.acked(2)
        await expect(page.locator(".now .card.open")).to_contain_text("a_is_small fails")
        await expect(page.get_by_role("status")).to_contain_text(UNREADY)


async def test_a_live_page_goes_on_behind_a_long_gap(server: Server, session: str, page: Page) -> None:
    failed: list[str] = []
    page.on("response", lambda answer: failed.append(answer.url) if answer.status == 422 else None)
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_events(*(make_event(i, at=i * SECOND, data=GOOD) for i in range(1, 61))))
        await monitor.acked(60)
        await page.goto(f"{server.url}/#/sessions/{session}")
        await painted(page, 0.9, "holds")
        await monitor.send(make_event(61, at=3 * 3600 * SECOND, data=BAD))
        await monitor.acked(61)
        await expect(page.locator(".now .card.open")).to_contain_text("a_is_small fails")
        await expect(page.locator(".lane.property .value")).to_have_text("✗ for 0.0 ms")
        await painted(page, 0.98, "fails")
    assert failed == []


async def test_a_part_of_time_that_is_not_loaded_shows_no_outcome(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        said = [BAD if 600 <= i < 900 else GOOD for i in range(1, 1201)]
        for first in (0, 400, 800):
            some = enumerate(said[first : first + 400], first + 1)
            await monitor.send(make_events(*(make_event(i, at=i * SECOND, data=data) for i, data in some)))
        await monitor.acked(1200)
    await page.goto(f"{server.url}/#/sessions/{session}")
    whole = page.locator("canvas.overview")
    await painted(page, 0.9, "holds")
    box = await whole.bounding_box()
    assert box is not None
    await whole.click(position={"x": 0.1 * box["width"], "y": 5})
    await painted(page, 0.9, "holds")
    await page.route("**/timeline?**", lambda route: route.abort())
    shown = page.locator(".time .shown")
    before = await shown.inner_text()
    await whole.click(position={"x": 0.6 * box["width"], "y": 5})
    await expect(shown).not_to_have_text(before)
    canvas = await page.locator(".lane.property canvas").element_handle()
    assert not await page.evaluate(PIXEL, [canvas, 0.5, "holds"]), "it fails there"
    await page.unroute("**/timeline?**")
    fails = f"([lane, at]) => ['fails', 'fails-soft'].some((name) => ({PIXEL})([lane, at, name]))"
    await page.wait_for_function(fails, arg=[canvas, 0.5])


async def test_a_spec_that_can_not_be_had_is_asked_for_again(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, at=1, data=GOOD))
        await monitor.acked(1)
        await page.route("**/api/v1/specs/single", lambda route: route.abort())
        await page.goto(f"{server.url}/#/sessions/{session}")
        await expect(page.locator(".lane.property")).to_have_count(1)
        await expect(page.locator(".lane.signal")).to_have_count(0)
        await page.unroute("**/api/v1/specs/single")
        await expect(page.locator(".lane.signal")).to_have_count(1)


async def test_what_nobody_observes_is_told_as_past(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, at=1, data=GOOD))
        await monitor.acked(1)
        await page.goto(f"{server.url}/#/sessions/{session}")
        card = page.locator(".now .card")
        await expect(card).to_have_attribute("data-state", "hold")
        await monitor.detach()
        await expect(card).to_contain_text("Its property held at the newest step; no monitor is there now")
        await expect(card).to_have_attribute("data-state", "not watched")


async def test_the_axis_of_days_has_dates_that_do_not_cover_each_other(server: Server, page: Page) -> None:
    await page.goto(server.url)
    labels = """async ([step, clock]) => {
      const { label, labelStep } = await import("./dashboard/window.js");
      return [label(1732147200000000000n, step, clock), labelStep(step, 1000)];
    }"""
    day = 86_400 * 10**9
    local = "new Date(1732147200000).toLocaleString('sv').slice(5, 16)"
    for step, clock, told in ((day, "wall", await page.evaluate(local)), (3650 * day, "wall", "2024-11-21")):
        assert (await page.evaluate(labels, [step, clock]))[0] == told
    for span in (day, 30 * day, 365 * day, 50 * 365 * day):
        step = (await page.evaluate(labels, [span, "wall"]))[1]
        assert step / span * 1000 >= 90, "pixels from one to the next"


async def test_a_session_by_another_text_of_its_spec_says_so(server: Server, session: str, page: Page) -> None:
    for bound in (5, 50):
        streams, formula = "[{topic: /a, signals: {v: msg.v}}]", f"not {{v > {bound}}}"
        text = f"id: {session}\nstreams: {streams}\nproperties: [{{id: low, formula: '{formula}'}}]\n"
        server.http.put(f"/api/v1/specs/{session}", content=text).raise_for_status()
        if bound == 5:
            assert server.http.post("/api/v1/sessions", json={"spec": session, "id": session}).status_code == 201
            await page.goto(f"{server.url}/#/sessions/{session}")
            await expect(page.locator(".facts")).to_contain_text("judged by")
            await expect(page.locator(".facts")).not_to_contain_text("another text")
    await page.reload()
    await expect(page.locator(".facts")).to_contain_text(f"judged by {session}, which has another text now")


async def test_that_nothing_has_come_for_long_is_told(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, at=1, data=GOOD))
        await monitor.acked(1)
        await page.goto(f"{server.url}/#/sessions/{session}")
        await expect(page.locator(".facts")).to_contain_text(re.compile(r"newest step \d+ days ago"))
        await monitor.send(make_event(2, data=GOOD) | {"stamp": time.time_ns()})
        await monitor.acked(2)
        await expect(page.locator(".facts")).not_to_contain_text("newest step")


async def test_what_nobody_looked_at_for_an_hour_is_not_shown_as_of_now(
    server: Server, session: str, page: Page
) -> None:
    held = Held()
    await page.add_init_script(
        "const later = setTimeout; setTimeout = (act, ms, ...more) => ms >= 5000 || later(act, ms, ...more);"
    )
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, at=1, data=GOOD))
        await monitor.acked(1)
        await page.goto(f"{server.url}/#/sessions/{session}")
        await expect(page.locator(".now .card")).to_contain_text("Its property holds")
        await page.route("**/api/v1/**", held)
        await page.evaluate("""() => {
            const now = Date.now;
            Date.now = () => now() + 3_600_000;
            document.dispatchEvent(new Event("visibilitychange"));
        }""")
        await expect(page.get_by_role("status")).to_contain_text("What is shown is of ")
        await expect(page.locator(".now")).to_have_css("filter", "grayscale(1)")
        held.open.set()
        await expect(page.get_by_role("status")).to_have_text("connected")


async def test_how_often_it_is_brought_up_to_date_is_told_where_that_is_seldom(server: Server, page: Page) -> None:
    async def much(route: Route) -> None:
        answer = await route.fetch()
        await route.fulfill(response=answer, headers={**answer.headers, "content-length": "380000"})

    await page.route("**/api/v1/recordings", much)
    await page.goto(server.url)
    await expect(page.get_by_role("status")).to_have_text(
        re.compile("^connected; there is much, and it is brought up to date every 15 s$")
    )


async def test_violations_that_are_out_of_view_are_told_too(server: Server, session: str, page: Page) -> None:
    """As on paper, or to who has the page read: beside the number of them stood that there are none."""
    await page.set_viewport_size({"width": 1280, "height": 300})
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, at=1, data=GOOD))
        await monitor.acked(1)
        await page.goto(f"{server.url}/#/sessions/{session}")
        await expect(page.get_by_role("region", name="violations")).to_have_text("None.")
        await expect(page.locator(".chart td > a")).to_have_count(1)
        await monitor.send(make_event(2, at=2, data=BAD))
        await expect(page.locator(".violations li")).to_have_count(1)
        await expect(page.locator(".chart td > a")).to_have_count(1)
        await expect(page.locator(".chart")).to_have_attribute("data-old", "")
        await page.emulate_media(media="print")
        told = "getComputedStyle(document.querySelector('.chart'), '::before').content"
        assert "Not brought up to date" in await page.evaluate(told)
        await page.emulate_media(media="screen")
        await page.locator(".chart").scroll_into_view_if_needed()
        await expect(page.locator(".chart td > a")).to_have_count(2)
        await expect(page.locator(".chart")).not_to_have_attribute("data-old", "")
