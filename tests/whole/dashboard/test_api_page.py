"""The API's own page asks the server that it is of, behind a proxy's path too, and sends a token that it is given."""

from __future__ import annotations

import json

from playwright.async_api import Page, Request, Route, expect

from tests.whole.conftest import Starts
from tests.whole.harness import run

LISTED = "#operations-sessions-list_sessions_api_v1_sessions_get"


async def test_what_is_tried_out_is_asked_of_this_server_with_the_token(start: Starts, page: Page) -> None:
    server = start(ORACLE_HISTORY="memory")
    token = run("token", "add", "reader", "--scope", "read", "--data-dir", server.data).stdout.split()[-1]
    prefix = f"{server.url}/robots/oracle"
    asked: list[Request] = []

    async def pass_on(route: Route) -> None:
        """As a proxy that takes the path away that it has put before the server's."""
        asked.append(route.request)
        await route.fulfill(response=await route.fetch(url=route.request.url.replace(prefix, server.url)))

    await page.route(f"{prefix}/**", pass_on)
    await page.goto(f"{prefix}/docs")
    await page.get_by_role("button", name="Authorize").first.click()
    await page.get_by_label("auth-bearer-value").fill(token)
    await page.get_by_role("button", name="Apply credentials").click()
    await page.get_by_role("button", name="Close", exact=True).click()
    listed = page.locator(LISTED)
    await listed.locator(".opblock-summary-control").click()
    await listed.get_by_role("button", name="Try it out").click()
    await listed.get_by_role("button", name="Execute").click()
    await expect(listed.locator(".live-responses-table .response .response-col_status")).to_have_text("200")
    assert json.loads(await listed.locator(".live-responses-table .highlight-code code").inner_text()) == {"items": []}
    assert asked[-1].url.startswith(f"{prefix}/api/v1/sessions")
