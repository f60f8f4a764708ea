"""Answers that are slow, or not as they should be: the page says so, and goes on."""

from __future__ import annotations

import asyncio
import json
import re
from urllib.parse import urlsplit

import pytest
from playwright.async_api import Page, Request, Route, expect

from tests.whole.client import attached, make_event
from tests.whole.harness import PATIENCE, Server

_IMPATIENT = """
const timeout = AbortSignal.timeout.bind(AbortSignal);
AbortSignal.timeout = (ms) => timeout(ms > 60000 ? ms : ms / 4);
"""
"""Ends the waits for ordinary answers after 2.5 s, less than four looks; those of minutes outlast the test."""
BIG, SMALL = {"v": 11}, {"v": 1}
MALFORMED = {
    "the list of sessions": ("#/", "**/api/v1/sessions?**", "{}"),
    "a session's state": ("#/sessions/{}", "**/api/v1/sessions/{}", "{}"),
    "its records": ("#/sessions/{}", "**/api/v1/sessions/{}/verdicts?**", "null"),
    "its violations": ("#/sessions/{}", "**/api/v1/sessions/{}/violations?**", '{"items": [{}]}'),
    "an explanation": ("#/sessions/{}?n=1", "**/api/v1/sessions/{}/verdicts/1/explanation", "null"),
    "the specs": ("#/specs", "**/api/v1/specs", "[]"),
}


@pytest.mark.parametrize(("address", "path", "body"), MALFORMED.values(), ids=MALFORMED)
async def test_a_malformed_answer_is_reported_and_the_page_goes_on(
    server: Server, session: str, page: Page, address: str, path: str, body: str
) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, at=1, data=BIG))
        await monitor.acked(1)

    async def spoil(route: Route) -> None:
        await route.fulfill(content_type="application/json", body=body)

    status = page.get_by_role("status")
    await page.route(path.format(session), spoil)
    await page.goto(f"{server.url}/{address.format(session)}")
    await expect(status).to_contain_text("not up to date")
    await page.unroute(path.format(session))
    await expect(status).to_have_text("connected")


async def test_older_violations_that_can_not_be_had_are_asked_for_again(
    server: Server, session: str, page: Page
) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(*(make_event(i, at=i, data=BIG if i % 2 else SMALL) for i in range(1, 51)))
        await monitor.acked(50)
    listed, path = page.locator(".violations li"), f"**/api/v1/sessions/{session}/violations?**"
    await page.goto(f"{server.url}/#/sessions/{session}")
    await expect(listed).to_have_count(20)
    await page.route(path, lambda route: route.abort())
    await page.get_by_role("button", name="Older ones").click()
    await expect(page.get_by_role("status")).to_contain_text("can't be reached")
    await page.unroute(path)
    await expect(listed).to_have_count(25)
    await expect(page.get_by_role("status")).to_have_text("connected")


PROXIES = {
    413: "What was sent is larger than a proxy in front of the server lets through (413): raise its limit, ",
    502: "A proxy in front of the server can't reach it (502): see whether the server runs; trying again.",
    401: "A proxy in front of the server wants a login (401): load this page again for it; trying again.",
    418: "A proxy in front of the server, and not the server, answered 418: see how it is set up; trying again.",
}


@pytest.mark.parametrize(("code", "told"), PROXIES.items())
async def test_what_a_proxy_answers_in_place_of_the_server_is_told_with_what_to_do(
    server: Server, page: Page, code: int, told: str
) -> None:
    async def refuse(route: Route) -> None:
        await route.fulfill(status=code, content_type="text/html", body="<h1>nginx</h1>")

    await page.route("**/api/v1/**", refuse)
    await page.goto(f"{server.url}/#/")
    status = page.get_by_role("status")
    await expect(status).to_contain_text(told)
    await expect(status.locator("form")).to_have_count(0)  # a token of the server's is not what is asked for


async def test_a_recording_that_a_proxy_refuses_as_too_large_says_so(server: Server, page: Page) -> None:
    async def refuse(route: Route) -> None:
        if route.request.method == "POST":
            await route.fulfill(status=413, content_type="text/html", body="<h1>nginx</h1>")
        else:
            await route.continue_()

    await page.route("**/api/v1/recordings**", refuse)
    await page.goto(f"{server.url}/#/")
    await expect(page.locator(".drop")).to_be_visible()
    file = {"name": "log.jsonl", "mimeType": "text/plain", "buffer": b"{}"}
    await page.get_by_label("recording", exact=True).set_input_files(file)  # type: ignore[arg-type]
    await expect(page.locator(".drop p.bad")).to_contain_text(f"log.jsonl: {PROXIES[413]}")


class Held:
    """Answers of explanations that are held until they are let go."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.open = asyncio.Event()

    async def __call__(self, route: Route) -> None:
        self.asked.append(route.request.url)
        await self.open.wait()
        await route.continue_()


async def test_an_explanation_is_asked_for_once_however_long_it_takes(server: Server, session: str, page: Page) -> None:
    held, looks = Held(), 0

    def count(request: Request) -> None:
        nonlocal looks
        looks += urlsplit(request.url).path.endswith(f"/sessions/{session}")

    await page.add_init_script(_IMPATIENT)
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, at=1, data=BIG))
        await monitor.acked(1)
        await page.route("**/explanation", held)
        page.on("request", count)
        await page.goto(f"{server.url}/#/sessions/{session}?n=1")
        verdict = page.locator(".verdict")
        await expect(verdict).to_contain_text("being computed")
        seen = looks
        await server.until(lambda: looks, lambda now: now >= seen + 4)
        await monitor.send(make_event(2, at=2, data=SMALL), make_event(3, at=3, data=BIG))
        await expect(page.locator(".violations li")).to_have_count(2)
        await expect(page.get_by_role("status")).to_have_text("connected")
        assert len(held.asked) == 1
        held.open.set()
        await expect(verdict).to_contain_text("currently_false")
        await expect(verdict).not_to_contain_text("being computed")
    assert len(held.asked) == 1


@pytest.mark.parametrize("leave", ["another verdict", "another page"])
async def test_an_explanation_that_nobody_looks_at_is_not_waited_for(
    server: Server, session: str, page: Page, leave: str
) -> None:
    held, failed = Held(), asyncio.Event()
    page.on("requestfailed", lambda request: failed.set() if "verdicts/1/explanation" in request.url else None)
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, at=1, data=BIG), make_event(2, at=2, data=SMALL))
        await monitor.acked(2)
    await page.route("**/verdicts/1/explanation", held)
    await page.goto(f"{server.url}/#/sessions/{session}?n=1")
    await expect(page.locator(".verdict")).to_contain_text("being computed")
    if leave == "another verdict":
        await page.get_by_role("link", name="a_is_small at step 2: currently_true").press("Enter")
        await expect(page.locator(".verdict h3")).to_have_text(re.compile("#2"))
    else:
        await page.get_by_role("link", name="Sessions").click()
        await expect(page.get_by_role("heading", level=1)).to_have_text("Sessions")
    async with asyncio.timeout(PATIENCE):
        await failed.wait()
    await expect(page.get_by_role("status")).to_have_text("connected")
    held.open.set()


async def test_a_verdict_that_is_chosen_is_not_replaced_by_the_name_of_what_is_still_shown(
    server: Server, session: str, page: Page
) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, at=1, data=BIG), make_event(2, at=2, data=SMALL))
        await monitor.acked(2)
    here = f"#/sessions/{session}?n="
    await page.goto(f"{server.url}/{here}1")
    await expect(page.locator(".verdict h3")).to_have_text(re.compile("#1"))
    # as where a timer of the page is due between a click and what the browser tells of it
    named = "async ([chosen, shown]) => { const { rename } = await import('./dashboard/address.js'); "
    await page.evaluate(f"{named} location.hash = chosen; rename(shown); }}", [f"{here}2", f"{here}1&shown"])
    await expect(page.locator(".verdict h3")).to_have_text(re.compile("#2"))


async def test_an_explanation_that_has_to_wait_is_asked_for_again(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, at=1, data=BIG))
        await monitor.acked(1)

    async def refuse(route: Route) -> None:
        body = json.dumps({"status": 503, "detail": "16 explanations are waited for already; ask again later"})
        await route.fulfill(status=503, content_type="application/problem+json", body=body)

    await page.route("**/explanation", refuse)
    await page.goto(f"{server.url}/#/sessions/{session}?n=1")
    await expect(page.locator(".verdict")).to_contain_text("ask again later")
    await expect(page.locator(".verdict")).to_contain_text("currently_false")
    await page.unroute("**/explanation")
    await expect(page.locator(".reasons > li").first).to_be_visible()


async def test_a_formula_that_could_not_be_had_is_asked_for_again(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, at=1, data=BIG))
        await monitor.acked(1)
    await page.route("**/parts?**", lambda route: route.abort())
    await page.goto(f"{server.url}/#/sessions/{session}?n=1")
    await expect(page.locator(".formula")).to_contain_text("The server can't be reached.")
    await page.unroute("**/parts?**")
    await expect(page.locator(".parts tbody tr").first).to_be_visible()
