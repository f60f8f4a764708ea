"""A real browser, in which nothing may go wrong and which may ask nobody but the server."""

from __future__ import annotations

import os
import shutil
from collections.abc import AsyncIterator
from urllib.parse import urlsplit

import pytest
from playwright.async_api import Browser, Page, async_playwright, expect

from tests.whole.harness import PATIENCE

_QUIET = [  # Chromium asks nobody on its own
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-quic",
    "--disable-sync",
    "--no-first-run",
]
_CONTAINED = ["--disable-dev-shm-usage"]  # a container has little of it, and a page that runs out of it crashes
_ROOT = ["--no-sandbox"] if os.geteuid() == 0 else []


@pytest.fixture
async def browser() -> AsyncIterator[Browser]:
    chromium = shutil.which("chromium")
    if chromium is None:
        missing = "Chromium is not here (Debian: apt-get install chromium)"
        if os.environ.get("CI"):
            pytest.fail(missing)
        pytest.skip(missing)
    expect.set_options(timeout=PATIENCE * 1000)
    async with async_playwright() as playwright:
        arguments = [*_QUIET, *_CONTAINED, *_ROOT]
        browser = await playwright.chromium.launch(executable_path=chromium, args=arguments, timeout=PATIENCE * 1000)
        yield browser
        await browser.close()


@pytest.fixture
async def page(browser: Browser) -> AsyncIterator[Page]:
    page = await browser.new_page()
    page.set_default_timeout(PATIENCE * 1000)
    errors: list[str] = []
    hosts: set[str | None] = set()
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda said: errors.append(said.text) if "Security Policy" in said.text else None)
    page.on("request", lambda request: hosts.add(urlsplit(request.url).hostname))
    yield page
    assert errors == []
    assert hosts <= {"127.0.0.1"}
