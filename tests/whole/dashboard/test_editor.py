"""Specs written in the dashboard."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.async_api import Page, expect

from oracle_server.edge.tokens import add
from tests.whole.client import attached, make_event
from tests.whole.conftest import Starts
from tests.whole.dashboard.focus import focus
from tests.whole.dashboard.test_troubles import Held
from tests.whole.harness import Server, problem

TEXT = """id: {id}
streams:
  - {{topic: /a, signals: {{v: msg.v}}}}
properties:
  - {{id: low, formula: '{{v < 5}}'}}
"""
FIELD, FINDINGS, DIFF = ".field textarea", ".findings button", ".diff"


@pytest.fixture
def spec(server: Server, session: str) -> str:
    """A spec that is there."""
    server.http.put(f"/api/v1/specs/{session}", content=TEXT.format(id=session)).raise_for_status()
    return session


async def test_a_spec_is_written_checked_and_stored_by_keyboard_alone(server: Server, session: str, page: Page) -> None:
    await page.goto(f"{server.url}/#/specs")
    await page.get_by_label("id of a new spec").fill(session)
    await page.keyboard.press("Enter")
    await expect(page.locator("#told")).to_have_text("sound")
    await focus(page.locator(FIELD))
    await page.keyboard.press("Control+A")
    await page.keyboard.insert_text(TEXT.format(id=session).replace("v < 5", "v <"))
    await expect(page.locator("#told")).to_have_text("not sound, 1 error")
    await expect(page.locator(FIELD)).to_have_attribute("aria-invalid", "true")
    await expect(page.get_by_role("button", name="Review and store…")).to_be_disabled()
    finding = page.locator(FINDINGS)
    place = re.match(r"(\d+):(\d+) error: ", await finding.inner_text())
    assert place is not None
    await expect(page.locator(".gutter .error")).to_have_text(place[1])
    await finding.press("Enter")
    await page.keyboard.insert_text("5")
    written = TEXT.format(id=session).splitlines()[int(place[1]) - 1].replace("v < 5", "v <")
    column = int(place[2]) - 1
    text = await page.locator(FIELD).input_value()
    assert text.splitlines()[int(place[1]) - 1] == written[:column] + "5" + written[column:]
    await page.keyboard.press("Control+A")
    await page.keyboard.insert_text(TEXT.format(id=session))
    await expect(page.locator(".formulas")).to_contain_text("{v < 5}")
    await expect(page.locator("#told")).to_have_text("sound")
    await page.keyboard.press("Control+s")
    await expect(page.locator(DIFF)).to_contain_text("+ streams:")
    await expect(page.locator(".review")).to_contain_text("No open session is judged by it.")
    await page.keyboard.press("Enter")
    await expect(page.get_by_text("Stored. Sessions that are opened from now on")).to_be_visible()
    assert server.get(f"specs/{session}")["text"] == TEXT.format(id=session)


async def test_what_changes_is_shown_and_who_keeps_the_old_text(server: Server, spec: str, page: Page) -> None:
    async with attached(server, session=f"{spec}-open", spec=spec, streams=["/a"]) as monitor:
        await monitor.send(make_event(1, at=1, data={"v": 9}))
        await monitor.acked(1)
        await page.goto(f"{server.url}/#/specs/{spec}")
        await page.get_by_role("link", name="Edit").click()
        await expect(page.locator("#told")).to_have_text("sound")
        await page.locator(FIELD).fill(TEXT.format(id=spec).replace("v < 5", "v < 50"))
        await page.get_by_role("button", name="Review and store…").click()
        await expect(page.locator(f"{DIFF} del")).to_have_text("- " + TEXT.format(id=spec).splitlines()[4])
        await expect(page.locator(f"{DIFF} ins")).to_contain_text("v < 50")
        old, new = [await page.locator(f"{DIFF} {sign}").bounding_box() for sign in ("del", "ins")]
        assert old is not None
        assert new is not None
        assert (new["x"], new["y"]) == (old["x"], old["y"] + old["height"]), "one stands below the other"
        await expect(page.locator(".review")).to_contain_text(
            f"1 open session keeps the text that it was opened with: {spec}-open"
        )
        await page.get_by_role("button", name="Store in place of what is there").click()
        await expect(page.get_by_text("Stored.")).to_be_visible()
        assert "v < 50" in server.get(f"specs/{spec}")["text"]
        await monitor.detach()


async def test_who_was_overtaken_loses_nothing_and_compares_with_what_is_there(
    server: Server, spec: str, page: Page
) -> None:
    await page.goto(f"{server.url}/#/edit/{spec}")
    await expect(page.locator("#told")).to_have_text("sound")
    mine, theirs = (TEXT.format(id=spec).replace("v < 5", f"v < {n}") for n in (6, 7))
    server.http.put(f"/api/v1/specs/{spec}", content=theirs).raise_for_status()
    await page.locator(FIELD).fill(mine)
    await page.get_by_role("button", name="Review and store…").click()
    await page.get_by_role("button", name="Store in place of what is there").click()
    await expect(page.get_by_text("Not stored: the spec was changed meanwhile.")).to_be_visible()
    assert server.get(f"specs/{spec}")["text"] == theirs
    await expect(page.locator(FIELD)).to_have_value(mine)
    await expect(page.locator(f"{DIFF} del")).to_contain_text("v < 7")
    await page.get_by_role("button", name="Store in place of what is there").click()
    await expect(page.get_by_text("Stored.")).to_be_visible()
    assert server.get(f"specs/{spec}")["text"] == mine


async def test_a_draft_outlives_the_way_to_another_page(server: Server, spec: str, page: Page) -> None:
    await page.goto(f"{server.url}/#/edit/{spec}")
    await expect(page.locator("#told")).to_have_text("sound")
    draft = TEXT.format(id=spec) + "# more to come\n"
    await page.locator(FIELD).fill(draft)
    await page.get_by_role("link", name="Sessions").click()
    await expect(page.get_by_role("heading", level=1)).to_have_text("Sessions")
    await page.go_back()
    await expect(page.locator(FIELD)).to_have_value(draft)
    await expect(page.get_by_text("Your draft, which is not stored.")).to_be_visible()


async def test_an_unsound_file_is_shown_and_mended(start: Starts, page: Page, tmp_path: Path) -> None:
    text = TEXT.format(id="torn").replace("v < 5", "v <")
    for name in ("torn", "other"):
        (tmp_path / "specs" / f"{name}.yaml").write_text(text.replace("torn", name), encoding="utf-8")
    server = start(ORACLE_HISTORY="memory")
    await page.goto(f"{server.url}/#/specs")
    await page.get_by_role("link", name="torn").click()
    await expect(page.locator(FIELD)).to_have_value(text)
    await expect(page.locator("#told")).to_have_text("not sound, 1 error")
    await page.locator(FIELD).fill(TEXT.format(id="torn"))
    await expect(page.locator("#told")).to_have_text("sound")
    await page.get_by_role("button", name="Review and store…").click()
    await expect(page.locator(f"{DIFF} del")).to_contain_text("{v <}")
    await page.get_by_role("button", name="Store in place of what is there").click()
    await expect(page.get_by_text("Stored. Sessions")).to_be_visible()
    assert server.get("specs/torn")["text"] == TEXT.format(id="torn")
    assert problem(server.http.get("/api/v1/specs/other"), 422)["text"] == text.replace("torn", "other")
    reader = {"Authorization": f"Bearer {add(server.data / 'tokens.json', 'reader', ['read'])}"}
    assert "text" not in problem(server.http.get("/api/v1/specs/other", headers=reader), 422), (
        "who can't store has none"
    )


async def test_hostile_texts_only_become_text(server: Server, session: str, page: Page) -> None:
    await page.goto(f"{server.url}/#/edit/{session}")
    await expect(page.locator("#told")).to_have_text("sound")
    hostile = "id: <img src=x onerror=alert(1)>\n\u202estreams: '</textarea><script>alert(1)</script>'\n"
    await page.locator(FIELD).fill(hostile)
    await expect(page.locator("#told")).to_contain_text("not sound")
    await expect(page.locator(FINDINGS).first).to_be_visible()
    assert await page.locator("main img, main script").count() == 0


async def test_without_the_scope_it_says_so(start: Starts, page: Page) -> None:
    server = start(ORACLE_HISTORY="memory")
    token = add(server.data / "tokens.json", "reader", ["read"])
    await page.goto(f"{server.url}/#/edit/lamp")
    await page.get_by_label("token").fill(token)
    await page.get_by_role("button", name="Use").click()
    await expect(page.locator("#told")).to_have_text("Not checked: the token lacks the scope `admin`")
    await expect(page.get_by_role("button", name="Review and store…")).to_be_disabled()


async def test_what_was_found_of_another_text_is_not_said_of_this_one(server: Server, spec: str, page: Page) -> None:
    held = Held()
    await page.goto(f"{server.url}/#/edit/{spec}")
    told, text = page.locator("#told"), page.locator(FIELD)
    await expect(told).to_have_text("sound")
    await page.route("**/check", held)
    await text.press("Control+Home")
    await text.press("End")
    async with page.expect_request("**/check"):
        await page.keyboard.type("?")
    await expect(told).to_have_text("Checking…")
    held.open.set()
    await expect(told).to_contain_text("not sound")
