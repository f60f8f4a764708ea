"""A million steps of thirty properties: zoomed and moved by asking little, and shown as the server tells them."""

from __future__ import annotations

import asyncio
from pathlib import Path

from playwright.async_api import Page, Response, expect

from tests.whole.client import BASE
from tests.whole.conftest import Starts
from tests.whole.dashboard.focus import focus
from tests.whole.dashboard.long import APART, EVERY, LONG, STEPS, fill
from tests.whole.dashboard.test_timeline import PIXEL
from tests.whole.harness import PATIENCE

MOVES = [
    *("0", "+", "+", "+", "ArrowLeft", "ArrowLeft", "+", "+", "+", "ArrowRight", "-", "+", "+", "+", "+"),
    *["ArrowRight"] * 4,
]
NAMED = """async () => {
  const { stretch } = await import("./dashboard/words.js");
  for (;;) {
    for (let frames = 0; frames < 2; frames++) await new Promise((drawn) => requestAnimationFrame(drawn));
    const query = new URLSearchParams(location.hash.split("?")[1]);
    const [from, to] = ["from", "to"].map((name) => query.get(name));
    const shown = document.querySelector(".time .shown").textContent;
    if (from && shown === stretch(BigInt(from), BigInt(to), "wall")) return [from, to];
  }
}"""
"""What the address names, once that is what is in view: while it is moved it is behind."""
LANE = ".lane.property:not(.fold)"


async def test_a_million_steps_are_zoomed_by_asking_little(start: Starts, page: Page, tmp_path: Path) -> None:
    server = start()
    assert server.http.post("/api/v1/sessions", json={"spec": "thirty", "id": "long"}).status_code == 201
    assert server.http.delete("/api/v1/sessions/long").status_code == 200
    assert server.stop() == 0
    fill(tmp_path / "data" / "history.sqlite", 1)
    server = start()
    answers: list[Response] = []
    page.on("response", lambda answer: answers.append(answer) if "/timeline?" in answer.url else None)
    await page.goto(f"{server.url}/#/sessions/long")
    await expect(page.get_by_role("button", name="29 properties hold in all of this time")).to_be_visible()
    await expect(page.locator(LANE)).to_have_count(1)
    await expect(page.locator(".now .card")).to_have_count(2)
    opened = len(answers)
    assert opened <= 4, "how far it reaches, and what is in view"
    await focus(page.locator(".plots"))
    for key in MOVES:
        await page.keyboard.press(key)
    canvas = await page.locator(f"{LANE} canvas").element_handle()
    async with asyncio.timeout(PATIENCE):
        since, until = map(int, await page.evaluate(NAMED))
    assert (until - since) / (STEPS * APART) < 0.01, "it is zoomed in"
    for began in range(EVERY, STEPS, EVERY):
        middle = BASE + (began + LONG // 2) * APART
        for at, colour in ((middle, "fails"), (middle + EVERY // 2 * APART, "holds")):
            if since + (until - since) // 50 < at < until:
                await page.wait_for_function(PIXEL, arg=[canvas, (at - since) / (until - since), colour])
    assert len(answers) - opened <= len(MOVES), "once a move at most"
    for answer in answers:
        assert len(await answer.body()) <= 2**20
