"""What was revised is shown as it stands, and what was said at first beside it."""

from __future__ import annotations

import re

from playwright.async_api import Page, expect

from tests.whole.client import attached
from tests.whole.harness import Server
from tests.whole.test_revised import move, stand_still

CAUSE = re.compile(r"^/odom \(topic 3 of m1\) came \d+ ms late \(#4\)$")


async def test_a_revised_verdict_is_shown_as_it_stands_and_a_retracted_violation_struck_through(
    server: Server, session: str, page: Page
) -> None:
    async with attached(server, session=session, spec="moving", features=["revisions"]) as monitor:
        await stand_still(monitor)
        await page.goto(f"{server.url}/#/sessions/{session}?n=2")
        verdict = page.locator(".verdict")
        await expect(verdict.get_by_role("heading")).to_contain_text("moves ✗ currently_false at step 2, ")
        await expect(page.locator(".chart .violation")).to_have_count(1)
        await expect(page.locator(".violations li")).to_have_count(1)
        await move(monitor)
        await monitor.expect("revision")
        await expect(verdict.get_by_role("heading")).to_contain_text("moves ✓ currently_true at step 2, ")
        await expect(verdict).to_contain_text(
            re.compile(r"Said at first: ✗ currently_false, and revised since /odom .* late #4")
        )
        said = "moves at step 2: currently_true, revised; said at first: currently_false"
        await expect(page.locator(".chart .revised")).to_have_attribute("title", said)
        await expect(page.locator(".chart .violation")).to_have_count(0)
        violation = page.locator(".violations li")
        await expect(violation).to_have_count(1)
        await expect(violation).to_have_class("retracted")
        await expect(violation.locator("s")).to_contain_text("moves does not hold at step 2")
        await expect(violation).to_contain_text("retracted")
        await expect(violation).to_have_attribute("title", CAUSE)
