"""Makes the pictures of the dashboard: python -m tests.whole.dashboard.pictures FOLDER."""

from __future__ import annotations

import asyncio
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import Literal, NamedTuple

from playwright.async_api import Browser, Page, expect

from tests.whole.dashboard import scene
from tests.whole.dashboard.chromium import MISSING, chromium, launched
from tests.whole.harness import PATIENCE, Server

WIDE, PHONE = (1280, 800), (390, 844)


class Picture(NamedTuple):
    """A view, and what is done in it before it is taken: keys, or what is clicked."""

    name: str
    address: str
    size: tuple[int, int] = WIDE
    scheme: Literal["light", "dark"] = "light"
    acts: tuple[str, ...] = ()
    wanted: str = ".lane.signal"


PICTURES = (
    Picture("fleet", "", wanted=".sessions .wrong"),
    Picture("session", "sessions/amr-07", acts=(".now .card.open",), wanted=".verdict .parts"),
    Picture("zoomed", "sessions/amr-07", acts=(".now .card.over", "+", "+"), wanted=".verdict .parts"),
    Picture("dark", "sessions/amr-22", scheme="dark", acts=("0", "]"), wanted=".verdict .parts"),
    Picture("spec", "specs/nav", wanted="pre"),
    Picture("phone", "sessions/amr-07", PHONE),
    Picture("phone_fleet", "", PHONE, "dark", wanted=".sessions .wrong"),
)


async def take(browser: Browser, server: Server, picture: Picture, folder: Path) -> Path:
    """Take one picture."""
    width, height = picture.size
    page = await browser.new_page(viewport={"width": width, "height": height}, color_scheme=picture.scheme)
    page.set_default_timeout(PATIENCE * 1000)
    await page.goto(f"{server.url}/#/{picture.address}")
    if picture.address.startswith("sessions/"):
        await expect(page.locator(".lane.signal").first).to_be_visible()
        await expect(page.locator(".now .card").first).to_be_visible()
    for act in picture.acts:
        await (page.locator(act).click() if act.startswith(".") else page.locator(".plots").press(act))
    await expect(page.locator(picture.wanted).first).to_be_visible()
    await _settled(page)
    path = folder / f"{picture.name}.png"
    await page.screenshot(path=path)
    await page.close()
    return path


async def _settled(page: Page) -> None:
    """Wait until all that was asked for is drawn: two answers more, and a frame."""
    for _ in range(2):
        async with page.expect_response(lambda answer: "/api/v1/" in answer.url):
            pass
    await page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


async def make(browser: Browser, folder: Path, work: Path) -> list[Path]:
    """All pictures, of a server that works in a folder of its own."""
    (work / "specs").mkdir()
    shutil.copy(scene.FOLDER / "nav.yaml", work / "specs")
    with Server(work / "specs", work / "data", ORACLE_HISTORY="memory") as server:
        async with scene.played(server, time.time_ns()):
            return [await take(browser, server, picture, folder) for picture in PICTURES]


async def main(folder: Path) -> None:
    path = chromium()
    if path is None:
        sys.exit(f"oracle-server: {MISSING}")
    folder.mkdir(parents=True, exist_ok=True)
    expect.set_options(timeout=PATIENCE * 1000)
    with tempfile.TemporaryDirectory() as work:
        async with launched(path) as browser:
            for made in await make(browser, folder, Path(work)):
                print(f"{made}: {made.stat().st_size // 1000} kB")


if __name__ == "__main__":
    asyncio.run(main(Path(sys.argv[1])))
