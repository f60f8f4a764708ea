"""The pictures in docs/ can be made, and something is on them."""

from __future__ import annotations

from base64 import b64encode
from pathlib import Path

from playwright.async_api import Browser

from tests.processes import ROOT
from tests.whole.dashboard.pictures import PICTURES, make

COLOURS = """async (text) => {
  const bytes = Uint8Array.from(atob(text), (each) => each.charCodeAt(0));
  const image = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
  const context = new OffscreenCanvas(image.width, image.height).getContext("2d");
  context.drawImage(image, 0, 0);
  const { data } = context.getImageData(0, 0, image.width, image.height);
  return [image.width, image.height, new Set(new Uint32Array(data.buffer)).size];
}"""


async def test_the_pictures_are_made_and_show_something(browser: Browser, tmp_path: Path) -> None:
    for name in ("made", "work"):
        (tmp_path / name).mkdir()
    made = await make(browser, tmp_path / "made", tmp_path / "work")
    assert [path.stem for path in made] == [picture.name for picture in PICTURES]
    page = await browser.new_page()
    for path, picture in zip(made, PICTURES, strict=True):
        width, height, colours = await page.evaluate(COLOURS, b64encode(path.read_bytes()).decode())
        assert (width, height) == picture.size
        assert colours > 100, f"{path.name} is blank"
    await page.close()


def test_each_picture_is_in_docs() -> None:
    shown = {path.stem for path in (ROOT / "docs" / "pictures").glob("*.png")}
    assert shown == {picture.name for picture in PICTURES}
