"""What is around a verdict, as somebody in front of a browser sees it: the formula by time, and who sent what."""

from __future__ import annotations

import json

import pytest
import pytest_asyncio
from playwright.async_api import Browser, Page, expect

from tests.whole.client import attached, make_clock, make_event
from tests.whole.dashboard.focus import focus
from tests.whole.dashboard.test_hostile import EVIL
from tests.whole.dashboard.test_troubles import Held
from tests.whole.harness import Server

MINUS = "\N{MINUS SIGN}"
OTHERS = ["/odom", "/chat"]


@pytest_asyncio.fixture(loop_scope="session")
async def told(server: Server, session: str, page: Page) -> str:
    """A command that is denied, one that is allowed, a call while it drives, and something late; and the page of it."""
    async with attached(server, session=session, spec="office") as monitor:
        await monitor.send(
            make_event(1, "/odom", at=10, data={"speed": 1}, source="/base"),
            make_event(2, "/dock", at=20, kind="request", call=4, data={"bay": 2}),
            make_event(3, "/dock", at=30, kind="response", call=4, data={"ok": True}),
            *(make_clock(stream, 60) for stream in OTHERS),
            *(make_clock("/dock", 60, kind) for kind in ("request", "response")),
        )
        assert (await monitor.ask(4, stream="/cmd", at=35, data={"v": 11}, source="/pilot"))["decision"] == "deny"
        assert (await monitor.ask(5, stream="/cmd", at=50, data={"v": 1}, source="/pilot"))["decision"] == "allow"
        await monitor.send(make_event(6, "/odom", at=15, data={"speed": 0}))
        await monitor.acked(6)
    await page.goto(f"{server.url}/#/sessions/{session}?n=4")
    return session


def row(page: Page, text: str) -> str:
    return f".parts tr:has(code:text-is({json.dumps(text)}))"


async def test_each_part_of_the_formula_is_told_at_each_step(page: Page, told: str) -> None:
    parts = page.get_by_role("table", name="parts of the formula")
    await expect(parts.locator("tbody tr")).to_have_count(5)
    whole, pre = page.locator(row(page, "->")), page.locator(row(page, "pre"))
    await expect(whole.locator("td").first).to_have_text("✗ fails")
    await expect(pre.locator("td").first).to_have_text("✓ holds")
    atom = page.locator(row(page, '{topic: "/odom", speed > 0}'))
    await expect(atom.locator("td").first).to_have_text("✗ fails")
    await expect(page.locator(".parts .cause code")).to_have_text("not")
    slider = page.get_by_role("slider", name="Step")
    await focus(slider)
    await page.keyboard.press("ArrowLeft")
    await expect(slider).to_be_focused()
    await expect(whole.locator("td").first).to_have_text("✓ holds")
    await expect(atom.locator("td").first).to_contain_text("speed = 1")
    await expect(atom.locator("td").first).to_contain_text("✓ holds")
    await page.get_by_role("link", name="explain", exact=True).click()
    await expect(page.locator(".verdict").get_by_role("heading")).to_contain_text(
        "docks_still ✓ currently_true at step 1"
    )
    await expect(page.locator(".steps .where")).to_contain_text("this verdict")


async def test_the_diagram_shows_who_sent_what_and_what_was_stopped(page: Page, told: str) -> None:
    await page.get_by_role("button", name="All streams").click()
    diagram = page.get_by_role("group", name="Events by time")
    names = diagram.locator(".lifeline > text:not(.hint)")
    await expect(names).to_have_count(7)
    assert {*await names.all_text_contents()} == {"/base", "a client", "/pilot", "m1", "/odom", "/dock", "/cmd"}
    said = [await each.get_attribute("aria-label") or "" for each in await diagram.locator("a").all()]
    rows = [text.split(": ", 1) for text in said]
    decided = [(at, text) for at, text in rows if text.startswith(("denied", "allowed"))]
    sent = [at for at, text in rows if (at, text) not in decided]
    assert sent == [f"{MINUS}10", f"{MINUS}5", "0", "+10", "+15", "+30"]
    waited = {text.split()[0]: float(at) for at, text in decided}  # ms; how long each was held differs from run to run
    assert (len(decided), sorted(waited)) == (2, ["allowed", "denied"])
    assert waited["denied"] >= 15
    assert waited["allowed"] >= 30
    denied = diagram.locator("a.denied")
    await expect(denied).to_have_count(1)
    await expect(denied.locator(".label")).to_contain_text("denied by cmd_small")
    await expect(denied.locator("circle.stop")).to_be_visible()
    end, line = await denied.locator("circle.stop").bounding_box(), await lifeline(page, "/cmd")
    assert end is not None
    assert end["x"] + end["width"] < line, "it does not reach those who listen"
    allowed, tip = diagram.locator("a.allowed"), await diagram.locator("a.allowed .tip").bounding_box()
    await expect(allowed).to_have_count(1)
    assert tip is not None
    assert abs(tip["x"] + tip["width"] - line) < 3
    await expect(diagram.locator("a.late")).to_have_count(1)
    await expect(diagram.locator("a.late .label")).to_contain_text("late")
    await expect(diagram.locator("a.violated:not(.denied)")).to_have_count(2)
    await expect(diagram.locator("rect.call")).to_have_count(1)
    await expect(diagram.locator("a.here")).to_have_count(1)


async def test_the_focus_comes_back_to_the_diagram_where_an_answer_is_slow(page: Page, told: str) -> None:
    held = Held()
    await page.route("**/verdicts/6/explanation", held)
    last = page.locator('.diagram a[href$="n=6"]')
    await focus(last)
    await page.keyboard.press("Enter")
    await expect(page.locator(".verdict")).to_contain_text("being computed")
    await expect(page.locator(".diagram a.here")).to_be_focused()
    held.open.set()
    await expect(page.locator(".verdict")).not_to_contain_text("being computed")
    await expect(page.locator(".diagram a.here")).to_be_focused()


async def lifeline(page: Page, name: str) -> float:
    box = await page.locator(".lifeline", has=page.locator(f'text:text-is("{name}")')).locator("line").bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2


async def test_the_diagram_is_walked_by_keys_and_opens_verdicts(page: Page, told: str) -> None:
    await expect(page.locator(".sequence .hint").first).to_have_text("4 events, 2 more do not concern docks_still")
    chosen = page.locator(".diagram a.here")
    await expect(page.locator('.diagram a[tabindex="0"]')).to_have_count(1)
    await focus(chosen)
    await page.keyboard.press("ArrowDown")
    await expect(chosen).not_to_be_focused()
    await page.set_viewport_size({"width": 1100, "height": 720})  # where it is drawn anew the same row is the stop
    wide = page.locator("svg.diagram")
    await page.wait_for_function("document.querySelector('svg.diagram').clientWidth <= 1100")
    await expect(wide.locator("a:focus")).to_have_count(1)
    await expect(chosen).not_to_be_focused()
    await page.keyboard.press("Enter")
    heading = page.locator(".verdict").get_by_role("heading")
    await expect(heading).to_contain_text("docks_still ✓ currently_true at step 3")
    await expect(page.locator(".diagram a.here")).to_be_focused()
    assert page.url.split("?")[1].endswith("n=6")


async def test_it_is_paged_along_time(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(*(make_event(i, at=i, data={"v": i % 7}) for i in range(1, 101)))
        await monitor.acked(100)
    await page.goto(f"{server.url}/#/sessions/{session}?n=50")
    times = page.locator(".diagram .when")
    await expect(times).to_have_count(16)
    await expect(times.first).to_have_text(f"{MINUS}8")
    await page.get_by_role("button", name="Earlier").click()
    await expect(times.first).to_have_text(f"{MINUS}24")
    await expect(page.get_by_role("button", name="Earlier")).to_be_focused()
    await page.get_by_role("button", name="Later").click()
    await expect(times.first).to_have_text(f"{MINUS}8")
    await page.get_by_role("button", name="Later").click()
    await expect(times.first).to_have_text("+8")
    await page.get_by_role("button", name="Here").click()
    await expect(times.first).to_have_text(f"{MINUS}8")


async def test_what_robots_and_specs_say_is_text_in_drawings_too(server: Server, session: str, page: Page) -> None:
    evil = EVIL.replace('"', " ")
    formula = json.dumps(f"not {{v: {json.dumps(evil)}}}")
    text = (
        f"id: {session}\nstreams:\n  - {{topic: /a, signals: {{v: msg.v}}}}\n"
        f"properties:\n  - {{id: p, formula: {formula}}}\n"
    )
    assert server.http.put(f"/api/v1/specs/{session}", content=text).status_code == 201
    async with attached(server, session=session, spec=session) as monitor:
        await monitor.send(make_event(1, at=1, data={"v": evil}, source=EVIL))
        await monitor.acked(1)
    await page.goto(f"{server.url}/#/sessions/{session}?n=1")
    await expect(page.locator(".diagram .lifeline title", has_text=EVIL)).to_have_count(1)
    await expect(page.locator(".parts code", has_text="<script>")).to_have_count(1)
    assert await page.evaluate("document.body.className") == ""
    assert await page.locator("main img, main script").count() == 0


async def test_two_sessions_are_compared_from_their_first_steps(server: Server, session: str, page: Page) -> None:
    other = f"{session}-b"
    for name, begin, bad in ((session, 0, range(30, 33)), (other, 5000, range(0))):
        async with attached(server, session=name, spec="single") as monitor:
            for i in range(1, 61):
                await monitor.send(make_event(i, at=begin + 100 * i, data={"v": 11 if i in bad else 1}))
            await monitor.acked(60)
    await page.goto(f"{server.url}/#/sessions/{session}")
    await page.get_by_role("link", name="Compare…").click()
    await page.get_by_role("link", name=other, exact=True).click()
    first = page.locator(".compared .first")
    await expect(first).to_contain_text(f"What differs first: a_is_small fails from 2.9 s in {session}, for")
    await expect(first).to_contain_text(f"{other} has no such episode.")
    cells = page.locator(".compared tbody td")
    await expect(cells.nth(1)).to_contain_text("1 violation, 1 episode, first at 2.9 s")
    await expect(cells.nth(2)).to_contain_text("no violations, no episodes")
    lanes = page.locator(".compared .lanes .strip")
    await expect(lanes.first.locator("rect.fails")).to_have_count(1)
    await expect(lanes.last.locator("rect.fails")).to_have_count(0)
    await page.goto(f"{server.url}/#/compare/{other}/{session}")
    await expect(first).to_contain_text(f"2.9 s in {session}")
    await page.goto(f"{server.url}/#/compare/{session}/{session}")
    await expect(first).to_contain_text("No episode differs. All properties stand alike.")


async def test_what_still_fails_is_compared_with_how_long_it_has_failed(
    server: Server, session: str, page: Page
) -> None:
    """An episode that is open has no end, and counted as none: one of hours stood as `0.0 ms in all`."""
    async with attached(server, session=session, spec="single") as monitor:
        for i in range(1, 61):
            await monitor.send(make_event(i, at=100 * i, data={"v": 11 if i >= 30 else 1}))
        await monitor.acked(60)
        await page.goto(f"{server.url}/#/compare/{session}/{session}")
        await expect(page.locator(".compared tbody td").nth(1)).to_contain_text("first at 2.9 s, 3.0 s so far")


@pytest.mark.parametrize("theme", ["light", "dark"])
async def test_it_fits_a_phone_in_both_themes(browser: Browser, server: Server, told: str, theme: str) -> None:
    context = await browser.new_context(viewport={"width": 390, "height": 844}, color_scheme=theme)  # type: ignore[arg-type]
    phone = await context.new_page()
    await phone.goto(f"{server.url}/#/sessions/{told}?n=4")
    await expect(phone.locator(".diagram a.here")).to_be_visible()
    await expect(phone.locator(".parts tbody tr")).to_have_count(5)
    assert await phone.evaluate("document.documentElement.scrollWidth") <= 390
    await context.close()
