"""A session that could not be restored, on the page."""

from __future__ import annotations

from pathlib import Path

from playwright.async_api import Page, expect

from tests.whole.conftest import copy_specs
from tests.whole.unrestored import REASON, unrestored


async def test_why_a_session_could_not_be_restored_is_shown(page: Page, tmp_path: Path) -> None:
    async with unrestored(copy_specs(tmp_path / "specs"), tmp_path / "data") as server:
        await page.goto(f"{server.url}/#/")
        await expect(page.get_by_role("row", name="unrestored")).to_contain_text(REASON)
        await expect(page.get_by_role("toolbar", name="Kinds")).to_contain_text("Wrong now 1")
        await page.goto(f"{server.url}/#/sessions/s")
        await expect(page.get_by_text(REASON)).to_be_visible()
        await expect(page.get_by_text("unrestored", exact=True)).to_be_visible()
        await expect(page.get_by_role("status")).to_have_text("connected")
        await expect(page.locator(".now .card")).to_contain_text("a_is_small fails")
        await expect(page.locator(".chart")).to_contain_text("Which properties it judges is not known")
