"""A real browser, in which nothing may go wrong and which may ask nobody but the server.

One is started for all tests here, each of which has pages of its own: they share a loop, as its connection is of one.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import AsyncIterator, Sequence
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import pytest_asyncio
from playwright.async_api import Browser, Page, expect

from tests.whole.dashboard.chromium import MISSING, chromium, launched
from tests.whole.harness import PATIENCE


def pytest_collection_modifyitems(items: Sequence[pytest.Item]) -> None:
    here = f"{Path(__file__).parent}{os.sep}"
    for item in items:
        if not isinstance(item, pytest.Function) or not str(item.path).startswith(here):
            continue
        if inspect.iscoroutinefunction(item.obj):
            item.add_marker(pytest.mark.asyncio(loop_scope="session"), append=False)


@pytest_asyncio.fixture(scope="session", loop_scope="session")
async def browser() -> AsyncIterator[Browser]:
    path = chromium()
    if path is None:
        if os.environ.get("CI"):
            pytest.fail(MISSING)
        pytest.skip(MISSING)
    expect.set_options(timeout=PATIENCE * 1000)
    async with launched(path) as browser:
        yield browser


@pytest_asyncio.fixture(loop_scope="session")
async def page(browser: Browser) -> AsyncIterator[Page]:
    errors: list[str] = []
    hosts: set[str | None] = set()
    async with await browser.new_page() as page:
        page.set_default_timeout(PATIENCE * 1000)
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("console", lambda said: errors.append(said.text) if "Security Policy" in said.text else None)
        page.on("request", lambda request: hosts.add(urlsplit(request.url).hostname))
        yield page
    assert errors == []
    assert hosts <= {"127.0.0.1"}
