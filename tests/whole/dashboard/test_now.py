"""What is wrong now, episodes, and addresses of a part of time, as somebody in front of a browser sees them."""

from __future__ import annotations

import re
import time
from collections.abc import AsyncIterator

import pytest_asyncio
from playwright.async_api import Page, expect

from tests.whole.client import BASE, Monitor, attached, make_event, make_events
from tests.whole.dashboard.focus import focus
from tests.whole.harness import Server

SECOND = 1000
FAILING = {10: 13, 30: 31, 50: 61}
"""Seconds from and to which events are violations; the last ones are open."""


def at_second(number: int) -> dict[str, object]:
    wrong = any(first <= number < behind for first, behind in FAILING.items())
    return make_event(number, at=number * SECOND, data={"v": 11 if wrong else 1})


@pytest_asyncio.fixture(loop_scope="session")
async def monitor(server: Server, session: str, page: Page) -> AsyncIterator[Monitor]:
    """A minute with an event a second and three episodes, of which the last one is open; and the page of it."""
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_events(*(at_second(i) for i in range(1, 61))))
        await monitor.acked(60)
        await page.goto(f"{server.url}/#/sessions/{session}")
        yield monitor


async def test_what_is_wrong_now_stands_on_top_with_how_long_it_is(page: Page, monitor: Monitor) -> None:
    cards = page.locator(".now .card")
    await expect(cards).to_have_count(2)
    await expect(cards.first).to_contain_text("a_is_small fails")
    await expect(cards.first.locator(".long")).to_have_text("10.0 s")
    await expect(cards.first).to_contain_text(re.compile("since .*00:50"))
    await expect(cards.first).to_contain_text("first: /a (topic 50 of m1)")
    await expect(cards.nth(1)).to_contain_text("a_is_small ended 30.0 s before the newest step")
    await expect(page.locator(".title")).to_contain_text("1 open episode")
    await expect(page.locator(".lane.property .value")).to_have_text("✗ for 10.0 s")
    top = await page.evaluate("document.querySelector('.lane.property').getBoundingClientRect().bottom")
    assert top < 720, "all of it is on the first screen"
    await monitor.send(at_second(61), make_event(62, at=62 * SECOND + 500, data={"v": 1}))
    await expect(page.locator(".now .card.open")).to_have_count(0)
    await expect(cards.first).to_contain_text("Its property holds")
    await expect(page.locator(".episodes tbody tr")).to_have_count(3)


async def test_what_failed_is_not_said_to_have_held_and_its_end_is_told_by_the_newest_step(
    server: Server, session: str, page: Page
) -> None:
    """The newest step may be of years ago, and that all properties held was said of what had failed for hours."""
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(
            make_events(*(make_event(i, at=i * SECOND, data={"v": 11 if i == 5 else 1}) for i in range(1, 20)))
        )
        await monitor.acked(19)
        await monitor.detach()
    await page.goto(f"{server.url}/#/sessions/{session}")
    cards = page.locator(".now .card")
    await expect(cards.first).to_have_text("Its property held at the newest step; no monitor is there now")
    await expect(cards.nth(1)).to_contain_text("a_is_small ended 14.0 s before the newest step")
    assert server.http.delete(f"/api/v1/sessions/{session}").status_code == 200
    await expect(cards.first).to_have_text("Its property holds at the end")


async def test_an_episode_of_just_now_ended_so_long_ago(server: Server, session: str, page: Page) -> None:
    begin = (time.time_ns() - BASE) // 10**6 - 20 * SECOND
    async with attached(server, session=session, spec="single") as monitor:
        for i in range(1, 21):
            await monitor.send(make_event(i, at=begin + i * SECOND, data={"v": 11 if i == 5 else 1}))
        await monitor.acked(20)
        await page.goto(f"{server.url}/#/sessions/{session}")
        await expect(page.locator(".now .card").nth(1)).to_contain_text("a_is_small ended 15.0 s ago")


async def test_a_session_without_a_known_outcome_is_not_called_good(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="single"):
        await page.goto(f"{server.url}/#/sessions/{session}")
        card = page.locator(".now .card")
        await expect(card).to_contain_text("1 of 1 not judged: a_is_small")
        await expect(card).not_to_contain_text("holds")


async def test_a_card_leads_to_its_time_and_explains(page: Page, monitor: Monitor) -> None:
    await page.locator(".time").get_by_role("button", name="10 s", exact=True).click()
    await page.locator(".now .card.over").click()
    await expect(page.locator(".verdict").get_by_role("heading")).to_contain_text("currently_false at step 30, ")
    await expect(page.locator(".cursor")).to_be_visible()
    await expect(page.locator(".time .shown")).to_contain_text("00:25")


async def test_keys_step_through_the_episodes(page: Page, monitor: Monitor) -> None:
    heading = page.locator(".verdict").get_by_role("heading")
    await expect(page.locator(".now .card")).to_have_count(2)
    await focus(page.locator(".plots"))
    for key, step in (("[", 30), ("[", 10), ("]", 30), ("]", 50), ("]", 50), ("[", 30)):
        await page.keyboard.press(key)
        await expect(heading).to_contain_text(f"currently_false at step {step}, ")
    await page.keyboard.press("Escape")
    await expect(page.locator(".verdict")).to_be_empty()


async def test_rows_are_walked_by_arrows_and_explained_by_enter(page: Page, monitor: Monitor) -> None:
    row = page.locator(".lane.property button")
    await expect(row).to_have_attribute(
        "aria-label", re.compile("^a_is_small: currently_false; failed .*00:50.* now, ")
    )
    await focus(page.locator(".plots"))
    await page.keyboard.press("ArrowDown")
    await expect(row).to_be_focused()
    await page.keyboard.press("Enter")
    await expect(page.locator(".verdict").get_by_role("heading")).to_contain_text("currently_false at step ")
    await page.keyboard.press("ArrowDown")
    await expect(page.locator(".lane.stream button")).to_be_focused()
    assert await page.locator(".plots button:not([tabindex='-1'])").count() == 0, "the rows are one stop"
    assert await page.locator(".time .tools button[tabindex='0']").count() == 1


async def test_the_focus_stays_where_it_is_as_a_robot_goes_on(page: Page, monitor: Monitor) -> None:
    """What changes each second was made anew, and who went there by keys was nowhere."""
    open_card = page.locator(".now .card.open")
    await focus(open_card)
    await monitor.send(make_event(61, at=61 * SECOND, data={"v": 11}))
    await expect(open_card.locator(".long")).to_have_text("11.0 s")
    await expect(open_card).to_be_focused()
    listed = page.locator(".violations a")
    await expect(listed).to_have_count(3)
    await focus(listed.first)
    await monitor.send(at_second(62), make_event(63, at=63 * SECOND, data={"v": 11}))
    await expect(listed).to_have_count(4)
    await expect(listed.nth(1)).to_be_focused()
    await page.keyboard.press("ArrowUp")
    await expect(listed.first).to_be_focused()


async def test_whether_it_happened_before_is_told_with_the_moment(server: Server, session: str, page: Page) -> None:
    text = (server.specs / "single.yaml").read_text().replace("id: single", f"id: {session}")  # no other has its spec
    assert server.http.put(f"/api/v1/specs/{session}", content=text).status_code == 201
    async with attached(server, session=session, spec=session) as monitor:
        await monitor.send(make_events(*(at_second(i) for i in range(1, 61))))
        await monitor.acked(60)
        await page.goto(f"{server.url}/#/sessions/{session}")
        await page.locator(".now .card.open").click()
        before = page.locator(".before")
        await expect(before).to_contain_text("2 in this session, none in others")
        await expect(before.locator("li")).to_have_count(2)
        await expect(before.locator("li").first).to_contain_text("20.0 s before, here for 0.0 ms")
        await page.locator(".facts").get_by_role("link", name=re.compile("00:10")).click()
        await expect(page.locator(".verdict").get_by_role("heading")).to_contain_text("currently_false at step 10, ")
        await expect(before).to_contain_text("Not that is known.")


async def test_the_address_of_a_moment_is_copied(page: Page, monitor: Monitor, session: str) -> None:
    await page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    await expect(page.locator(".lane.property")).to_have_count(1)
    goes_on = "() => { const later = setTimeout; window.setTimeout = (act, ms) => ms === 2000 || later(act, ms); }"
    await page.evaluate(goes_on)  # what is said, however slow this is
    await page.get_by_role("button", name="Copy link").click()
    await expect(page.get_by_role("button", name="Copied")).to_be_visible()
    copied = await page.evaluate("navigator.clipboard.readText()")
    assert re.search(rf"#/sessions/{session}\?from=\d+&to=\d+$", copied), "also where it is live"
    await page.goto("about:blank")
    await page.goto(copied)
    await expect(page.locator(".time button.live")).to_have_text("Go live")


async def test_a_narrow_page_has_a_bar_that_goes_to_the_parts(page: Page, monitor: Monitor) -> None:
    bar = page.get_by_role("navigation", name="Parts of the session")
    await expect(bar).to_be_hidden()
    await page.set_viewport_size({"width": 390, "height": 844})
    await expect(page.locator(".lane.property")).to_have_count(1)
    await bar.get_by_role("button", name="Why").click()
    await expect(page.locator(".verdict").get_by_role("heading")).to_be_in_viewport()
    await expect(page.locator(".verdict")).to_contain_text("a_is_small")
    await bar.get_by_role("button", name="Now").click()
    await expect(page.locator(".now .card.open")).to_be_in_viewport()
    await expect(bar.locator("[aria-current]")).to_have_text("Now")


async def test_an_address_opens_the_same_part_of_time_and_the_same_verdict(
    page: Page, monitor: Monitor, server: Server, session: str
) -> None:
    begin = BASE + 9 * 10**9
    address = f"{server.url}/#/sessions/{session}?from={begin}&to={begin + 10 * 10**9}&n=11"
    await page.goto("about:blank")
    await page.goto(address)
    await expect(page.locator(".verdict").get_by_role("heading")).to_contain_text("at step 11, ")
    live = page.locator(".time button.live")
    await expect(live).to_have_text("Go live")
    await expect(page.locator(".time .shown")).to_have_text(re.compile("00:09.000 to .*00:19.000"))
    assert page.url == address
    await focus(page.locator(".plots"))
    await page.keyboard.press("ArrowRight")
    await expect(page).to_have_url(re.compile(f"from={begin + 2 * 10**9}&to={begin + 12 * 10**9}&n=11$"))
    await page.keyboard.press("l")
    await expect(page).to_have_url(re.compile(rf"/{session}\?n=11$"))
    await page.reload()
    await expect(live).to_have_text("Live")


async def test_what_holds_in_all_that_is_in_view_is_one_row(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="thirty") as monitor:
        await monitor.send(
            make_events(*(make_event(i, at=i * SECOND, data={"v": 27 if i == 20 else 0}) for i in range(1, 61)))
        )
        await monitor.acked(60)
        await page.goto(f"{server.url}/#/sessions/{session}")
        fold = page.get_by_role("button", name="29 properties hold in all of this time")
        await expect(fold).to_have_attribute("aria-expanded", "false")
        await expect(page.locator(".lane.property")).to_have_count(2)
        await expect(page.locator(".lane.property button").first).to_have_text("never_27")
        await fold.click()
        await expect(fold).to_have_attribute("aria-expanded", "true")
        await expect(page.locator(".lane.property")).to_have_count(31)
        await fold.click()
        await page.locator(".time").get_by_role("button", name="10 s", exact=True).click()
        await expect(page.get_by_role("button", name="30 properties hold in all of this time")).to_be_visible()
        await expect(page.locator(".lane.property")).to_have_count(1)
        await monitor.send(make_event(61, at=61 * SECOND, data={"v": 27}))
        await expect(page.locator(".lane.property button").first).to_have_attribute(
            "aria-label", re.compile("^never_27: currently_false")
        )
