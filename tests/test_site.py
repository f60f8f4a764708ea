"""The documents as a site: without a warning, with nothing from elsewhere or left out, searched without a server."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer
from playwright.async_api import Request, expect

from oracle_server.cli.commands import app
from tests.processes import PATIENCE, ROOT
from tests.whole.dashboard.chromium import MISSING, chromium, launched

NARROW = ("index", "tutorial", "guard-nav2", "ci", "comparison", "spec", "cli", "http", "wire", "operations")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    made = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", folder],
        check=False,
        cwd=ROOT,
        capture_output=True,
        encoding="utf-8",
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
    )
    assert made.returncode == 0, made.stderr
    assert "WARNING" not in made.stderr
    return folder


def test_nothing_is_loaded_from_elsewhere(site: Path) -> None:
    loaded = [
        (page.name, tag)
        for page in site.rglob("*.html")
        for tag in re.findall(r"<(?:script|link|img|iframe)\b[^>]*>", page.read_text(encoding="utf-8"))
        if re.search(r"\b(?:src|href)=\"?(?:https?:)?//", tag) and 'rel="canonical"' not in tag
    ]
    assert len(list(site.rglob("*.html"))) > 25
    assert loaded == []


def test_every_document_is_in_the_navigation() -> None:
    named = set(re.findall(r": ([\w-]+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE))
    assert {path.name for path in (ROOT / "docs").glob("*.md")} <= named, "mkdocs.yml has a `nav`"


def test_every_command_and_request_is_told(site: Path) -> None:
    told = headings(site / "cli.html")
    command: Any = typer.main.get_command(app)
    assert set(command.commands) <= {name.split()[0] for name in told}
    paths = json.loads((ROOT / "docs" / "openapi.json").read_text(encoding="utf-8"))["paths"]
    asked = {f"{method.upper()} {path}" for path, methods in paths.items() for method in methods}
    assert asked <= headings(site / "http.html")
    forms = json.loads((ROOT / "docs" / "wire.schema.json").read_text(encoding="utf-8"))["$defs"]
    assert forms.keys() - {"from_monitor", "from_server"} <= headings(site / "wire.html")


def headings(page: Path) -> set[str]:
    return set(re.findall(r"<h[23] id=[^>]*>([^<]*)<", page.read_text(encoding="utf-8")))


async def test_the_site_is_read_and_searched_from_the_disk(site: Path) -> None:
    path = chromium()
    if path is None:
        if os.environ.get("CI"):
            pytest.fail(MISSING)
        pytest.skip(MISSING)
    asked: list[str] = []

    def note(request: Request) -> None:
        if not request.url.startswith("file:"):
            asked.append(request.url)

    async with launched(path) as browser:
        page = await browser.new_page(viewport={"width": 1440, "height": 900})
        page.set_default_timeout(PATIENCE * 1000)
        page.on("request", note)
        await page.goto((site / "index.html").as_uri())
        await page.locator(".md-search__input").click()  # it reads its index only then
        ready = page.locator(".md-search-result__meta", has_text="Type to start searching")
        await expect(ready).to_have_count(1, timeout=PATIENCE * 1000)
        await page.keyboard.type("lasting")
        found = page.locator(".md-search-result__item", has_text="Cookbook").first
        await expect(found).to_be_visible(timeout=PATIENCE * 1000)
        await page.set_viewport_size({"width": 390, "height": 844})
        for name in NARROW:
            await page.goto((site / f"{name}.html").as_uri())
            assert await page.evaluate("document.scrollingElement.scrollWidth") == 390, name
    assert asked == []
