"""What was revised is shown as it stands, and what was said at first beside it."""

from __future__ import annotations

import re
from typing import Any
from urllib.parse import parse_qs, urlsplit

from playwright.async_api import Page, Route, expect

from tests.whole.client import attached, make_event
from tests.whole.harness import Server

STAMP = 1732147200000000000
LATE = {"monitor": "m1", "seq": 9, "stream": "/b", "kind": "topic", "stamp": STAMP}
CAUSE = "/b (topic 9 of m1) came 310 ms late"
STANDS = {"outcome": "currently_true", "violation": False, "explanation": None, "revised": 4}


def revision(of: dict[str, Any]) -> dict[str, Any]:
    """The record of a revision, by which a violation does not stand."""
    stands = {"outcome": "currently_true", "violation": False, "explanation": None, "retracted": True}
    row = {**of, "n": 4, "step": None, "kind": "revision", "stream": "", "monitor": "", "seq": -1, **stands}
    return row | {
        "arrived": STAMP + 310 * 10**6,
        "revises": {"from": 2, "to": 2},
        "because": [LATE],
        "causes": 1,
    }


async def revise(route: Route) -> None:
    """Answer as a session in which the second verdict was revised."""
    url = urlsplit(route.request.url)
    view, descending = parse_qs(url.query)["as"][0], "order=desc" in url.query
    answer = await route.fetch()
    found = await answer.json()
    by_number = {each["n"]: each for each in found["items"]}
    if view == "standing" and 2 in by_number:
        by_number[2] |= STANDS
    if view == "all" and (2 in by_number or "after=3" in url.query):
        by_number[4] = revision(by_number.get(2, {"property": "a_is_small", "order": "publication"}))
    found["items"] = [by_number[n] for n in sorted(by_number, reverse=descending)]
    await route.fulfill(json=found)


async def test_a_revised_verdict_is_shown_as_it_stands_and_a_retracted_violation_struck_through(
    server: Server, session: str, page: Page
) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(*(make_event(i, at=i, data={"v": 11 if i == 2 else 1}) for i in (1, 2, 3)))
        await monitor.acked(3)

    async def explain(route: Route) -> None:
        answer = await route.fetch()
        await route.fulfill(json=await answer.json() | STANDS)

    await page.route(re.compile(r"/(verdicts|violations)\?"), revise)
    await page.route("**/verdicts/2/explanation", explain)
    await page.goto(f"{server.url}/#/sessions/{session}")
    cell = page.locator(".chart .revised")
    said = "a_is_small at step 2: currently_true, revised; said at first: currently_false"
    await expect(cell).to_have_attribute("title", said)
    await expect(page.locator(".chart .violation")).to_have_count(0)
    violation = page.locator(".violations li")
    await expect(violation).to_have_count(1)
    await expect(violation).to_have_class("retracted")
    await expect(violation.locator("s")).to_contain_text("a_is_small does not hold at step 2")
    await expect(violation).to_contain_text("retracted")
    await expect(violation).to_have_attribute("title", f"{CAUSE} (#4)")
    await violation.get_by_role("link").click()
    verdict = page.locator(".verdict")
    await expect(verdict.get_by_role("heading")).to_contain_text("a_is_small ✓ currently_true at step 2, ")
    await expect(verdict).to_contain_text(f"Said at first: ✗ currently_false, and revised since {CAUSE} #4")
