"""What must not happen to a dashboard: code from a robot's messages, a lost token, a wrong number, a frozen page."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.async_api import Page, expect

from oracle_server.edge.tokens import add
from tests.processes import reserved_port
from tests.whole.client import attached, make_event
from tests.whole.conftest import Starts
from tests.whole.harness import Server

EVIL = "<img src=x onerror=\"document.body.className='taken'\"><script>document.body.className='taken'</script>"


async def test_what_a_robot_says_is_text_and_never_a_page(server: Server, session: str, page: Page) -> None:
    text = (
        f"id: {session}\ndescription: {json.dumps(EVIL)}\nstreams:\n  - topic: /a\n    signals: {{v: msg.v}}\n"
        f"properties:\n  - {{id: p, description: {json.dumps(EVIL)}, formula: 'not {{v: *}}'}}\n"
    )
    assert server.http.put(f"/api/v1/specs/{session}", content=text).status_code == 201
    async with attached(server, session=session, spec=session) as monitor:
        await monitor.send(make_event(1, at=1, data={"v": EVIL}))
        await monitor.acked(1)
        for address in (f"#/specs/{session}", f"#/sessions/{session}", f"#/sessions/{session}?n=1"):
            await page.goto(f"{server.url}/{address}")
            await expect(page.get_by_text(EVIL[:18]).first).to_be_visible()
        await page.locator("summary").last.click()
        await expect(page.locator("dd", has_text=EVIL[:18]).last).to_be_visible()
    assert await page.evaluate("document.body.className") == ""
    assert await page.locator("main img, main script").count() == 0


async def test_no_text_is_told_in_another_order_or_looks_like_another(server: Server, session: str, page: Page) -> None:
    """What stands behind such a character was told from right to left, and `go` with one in it looked like `go`."""
    text = (
        f"id: {session}\nstreams: [{{topic: /a, signals: {{v: msg.v}}}}]\n"
        "properties: [{id: p, formula: 'not {v: *}'}]\n"
    )
    server.http.put(f"/api/v1/specs/{session}", content=text.encode()).raise_for_status()
    async with attached(server, session=session, spec=session) as monitor:
        await monitor.send(make_event(1, at=1, data={"v": "\u202eg\u200bo"}, source="/nav\u2066\x1b"))
        await monitor.acked(1)
        await page.goto(f"{server.url}/#/sessions/{session}?n=1")
        await page.get_by_text("signals of the event").click()
        await expect(page.locator("dl").last).to_contain_text(r"\u202eg\u200bo")
        await expect(page.locator(".sequence")).to_contain_text(r"/nav\u2066\u001b")
        assert not set("\u202e\u200b\u2066\x1b") & set(await page.locator("main").inner_text())


async def test_properties_have_names_of_what_any_object_has(
    server: Server, session: str, name: Callable[[], str], page: Page
) -> None:
    """`constructor` was looked up in a session that has no such property, and found: the page stayed empty."""
    properties = "".join(f"  - {{id: {each}, formula: 'not {{v: *}}'}}\n" for each in ("constructor", "__proto__"))
    text = f"id: {session}\nstreams: [{{topic: /a, signals: {{v: msg.v}}}}]\nproperties:\n{properties}"
    server.http.put(f"/api/v1/specs/{session}", content=text).raise_for_status()
    other = name()
    async with (
        attached(server, session=session, spec=session) as monitor,
        attached(server, session=other, spec="single") as plain,
    ):
        for each in (monitor, plain):
            await each.send(make_event(1, at=1, data={"v": 1}))
            await each.acked(1)
        for address in (f"#/sessions/{session}?n=1", f"#/compare/{session}/{other}", f"#/compare/{other}/{session}"):
            await page.goto(f"{server.url}/{address}")
            await expect(page.locator("main").get_by_text("constructor").first).to_be_visible()
            await expect(page.locator("main").get_by_text("__proto__").first).to_be_visible()
            await expect(page.get_by_role("status")).to_have_text("connected")


async def test_the_description_of_the_api_is_drawn_within_its_policy(server: Server, page: Page) -> None:
    answer = await page.goto(f"{server.url}/docs")
    assert answer
    assert "content-security-policy" in answer.headers
    await page.get_by_text("/api/v1/sessions/{session_id}/stream").first.click()
    await expect(page.get_by_text("Last-Event-ID").first).to_be_visible()


@pytest.mark.parametrize(
    ("address", "told"),
    [
        ("#/sessions/nowhere", "no session 'nowhere' is known"),
        ("#/sessions/nowhere?n=x", "no session 'nowhere' is known"),
        ("#/specs/nowhere", "no spec 'nowhere'"),
        ("#/sessions/%ff", "connected"),
        ("#//", "connected"),
        (f"#/sessions/{'z' * 300}", "is known"),
    ],
)
async def test_an_address_of_nothing_is_told(server: Server, page: Page, address: str, told: str) -> None:
    await page.goto(f"{server.url}/{address}")
    await expect(page.get_by_role("status")).to_contain_text(told)
    assert await page.evaluate("document.documentElement.scrollWidth <= innerWidth"), "all of it is in view"


def test_the_browser_is_told_to_run_nothing_else(server: Server) -> None:
    told = server.http.get("/")
    assert "default-src 'none'; script-src 'self'; style-src 'self'" in told.headers["Content-Security-Policy"]
    assert "unsafe" not in told.headers["Content-Security-Policy"]
    assert "frame-ancestors 'none'" in told.headers["Content-Security-Policy"]


async def test_numbers_are_shown_as_they_are(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, at=1, data={"v": 2**63 - 1}))
        await monitor.acked(1)
    await page.goto(f"{server.url}/#/sessions/{session}?n=1")
    await page.get_by_text("signals of the event").click()
    await expect(page.locator("dl").last).to_contain_text("9223372036854775807")


async def test_a_token_is_asked_for_and_kept_to_oneself(start: Starts, tmp_path: Path, page: Page) -> None:
    (tmp_path / "data").mkdir()
    secret = add(tmp_path / "data" / "tokens.json", "reader", ["read"])
    submits = add(tmp_path / "data" / "tokens.json", "robot", ["submit"])
    server = start()
    assert server.http.get("/api/v1/sessions").status_code == 401
    await page.goto(f"{server.url}/")
    field = page.get_by_label("token")
    await field.fill("wrong")
    await page.get_by_role("button", name="Use").click()
    await expect(field).to_have_value("")
    await field.fill(submits)
    await page.get_by_role("button", name="Use").click()
    await expect(page.get_by_role("status")).to_contain_text("the token lacks the scope `read`")
    await field.fill(secret)
    await page.get_by_role("button", name="Use").click()
    await expect(page.get_by_role("status")).to_have_text("connected")
    await page.reload()
    await expect(page.get_by_role("status")).to_have_text("connected")
    assert secret not in page.url
    assert secret not in server.log


async def test_a_token_with_a_character_that_none_has_is_asked_for_again(
    start: Starts, tmp_path: Path, page: Page
) -> None:
    """No header can have it, so that nothing was sent: the page said that the server can't be reached, for good."""
    (tmp_path / "data").mkdir()
    secret = add(tmp_path / "data" / "tokens.json", "reader", ["read"])
    server = start()
    await page.goto(f"{server.url}/")
    field, use = page.get_by_label("token"), page.get_by_role("button", name="Use")
    await field.fill(f"“{secret}”")
    await use.click()
    await expect(page.get_by_role("status")).to_contain_text("The token has a character that no token has.")
    await page.reload()
    await field.fill(secret)
    await use.click()
    await expect(page.get_by_role("status")).to_have_text("connected")


async def test_a_server_that_is_away_is_told_and_found_again(start: Starts, page: Page) -> None:
    with reserved_port() as place:
        port = str(place.getsockname()[1])
        server = start(port=port)
        async with attached(server, session="s", spec="single") as monitor:
            await monitor.send(make_event(1, at=1, data={"v": 1}))
            await monitor.acked(1)
        await page.goto(f"{server.url}/#/sessions/s")
        cell = page.get_by_role("link", name="a_is_small at step 1: currently_true")
        await expect(cell).to_be_visible()
        server.stop()
        await expect(page.get_by_role("status")).to_contain_text("can't be reached")
        await expect(cell).to_be_visible()
        start(port=port)
        await expect(page.get_by_role("status")).to_have_text("connected")
