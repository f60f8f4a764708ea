"""A real Chromium."""

from __future__ import annotations

import os
import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from playwright.async_api import Browser, async_playwright

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
MISSING = "Chromium is not here (Debian: apt-get install chromium-headless-shell)"


def chromium() -> str | None:
    """Where it is, None where it is not; the one without windows opens a page in a third of the time."""
    return shutil.which("chromium-headless-shell") or shutil.which("chromium")


@asynccontextmanager
async def launched(path: str) -> AsyncIterator[Browser]:
    """A browser."""
    async with async_playwright() as playwright:
        arguments = [*_QUIET, *_CONTAINED, *_ROOT]
        browser = await playwright.chromium.launch(executable_path=path, args=arguments, timeout=PATIENCE * 1000)
        yield browser
        await browser.close()
