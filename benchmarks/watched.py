"""What a page in a browser costs decisions, and how smooth it is, of a session of thirty properties.

python benchmarks/watched.py [--rate 1000] [--seconds 10] [--rounds 3]

Decisions are asked for alone and beside the page, in turns; what is told of them is the ratio of both, from this very
run. The page is live meanwhile, at so many events a second. Its frames are timed in a turn of their own, since that
lets the browser paint sixty times a second. The browser keeps to one core, and all else to the others, as an operator's
browser is on a machine of its own. Chromium must be installed.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import shutil
import tempfile
import time
from itertools import count
from pathlib import Path
from statistics import median

from playwright.async_api import Browser, async_playwright
from served import Server, hello, percentile, until
from websockets.asyncio.client import ClientConnection

PROPERTIES = 30
SPEC = "id: thirty\nstreams:\n  - topic: /a\n    signals: {v: msg.v}\nproperties:\n" + "".join(
    f"  - {{id: never_{i}, formula: 'not {{topic: \"/a\", v: {i}}}'}}\n" for i in range(1, PROPERTIES + 1)
)
TURN = 0.02
"""Seconds from one batch of events to the next."""
PAUSE = 0.005
"""Seconds between two questions for a decision."""
FRAMES = """() => {
  window.frames_ = [];
  let before = performance.now();
  const frame = (now) => { window.frames_.push(now - before); before = now; requestAnimationFrame(frame); };
  requestAnimationFrame(frame);
}"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rate", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--rounds", type=int, default=3)
    asyncio.run(measure(**vars(parser.parse_args())))


async def measure(rate: int, seconds: float, rounds: int) -> None:
    chromium = shutil.which("chromium")
    if chromium is None:
        raise SystemExit("Chromium is not here (Debian: apt-get install chromium)")
    *others, last = sorted(os.sched_getaffinity(0))
    if not others:
        raise SystemExit("this takes two cores: one is the browser's")
    with tempfile.TemporaryDirectory() as folder:
        os.sched_setaffinity(0, {last})  # what is started from here on keeps to it
        async with async_playwright() as playwright:
            browser = await playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
            os.sched_setaffinity(0, others)
            server = Server(Path(folder), {"thirty": SPEC}, ORACLE_MAX_RATE="0")
            try:
                await rounds_of(server, browser, rate, seconds, rounds)
            finally:
                await browser.close()
                server.stop()


async def rounds_of(server: Server, browser: Browser, rate: int, seconds: float, rounds: int) -> None:
    """Measure with a server and a browser that are there, and print what is told of them."""
    async with server.attach() as feeding, server.attach() as asking:
        feed = asyncio.create_task(fed(feeding, rate))
        await asking.send(json.dumps(hello("asked", "thirty")))
        await until(asking, "attached")
        try:
            ratios = [await compared(server, browser, asking, seconds) for _ in range(rounds)]
            print(f"99 % of decisions beside the page: {median(ratios):.2f} times alone (median of {rounds})")
        finally:
            feed.cancel()


async def fed(socket: ClientConnection, rate: int) -> None:
    """Send so many events a second, of which some violate one property; what comes back is thrown away."""
    await socket.send(json.dumps(hello("watched", "thirty")))
    await until(socket, "attached")
    reading = asyncio.create_task(_thrown(socket))
    seq, begin = 0, time.perf_counter()
    try:
        while True:
            wanted = int((time.perf_counter() - begin) * rate)
            now = time.time_ns()
            events = [_event(each, now) for each in range(seq + 1, wanted + 1)]
            if events:
                await socket.send(json.dumps({"type": "events", "events": events}))
            seq = max(seq, wanted)
            await asyncio.sleep(TURN)
    finally:
        reading.cancel()


async def _thrown(socket: ClientConnection) -> None:
    async for _ in socket:
        pass


def _event(seq: int, at: int) -> dict[str, object]:
    v = 27 if seq % 5000 < 200 else 100 + seq % 50
    return {"type": "event", "seq": seq, "stream": "/a", "stamp": at + seq % 1000, "data": {"v": v}}


async def compared(server: Server, browser: Browser, asking: ClientConnection, seconds: float) -> float:
    """One round: alone, and beside the page; the ratio of the 99th percentiles."""
    alone = await decisions(asking, seconds)
    page = await browser.new_page()
    await page.goto(f"http://127.0.0.1:{server.port}/#/sessions/watched")
    await page.locator(".lane.stream").first.wait_for()
    beside = await decisions(asking, seconds)
    await page.evaluate(FRAMES)
    await asyncio.sleep(seconds)
    frames: list[float] = await page.evaluate("window.frames_")
    await page.close()
    ratio: float = percentile(beside, 99) / percentile(alone, 99)
    print(
        f"99 % of decisions: {ratio:.2f} times alone; the longest of {len(frames)} frames {max(frames):.0f} ms, "
        f"99 % of them {percentile(frames, 99):.0f} ms"
    )
    return ratio


_numbers = count(1)
"""Of what is asked; they go on from round to round."""


async def decisions(socket: ClientConnection, seconds: float) -> list[float]:
    """The times from an ask to its decision, in ms."""
    times: list[float] = []
    end = time.perf_counter() + seconds
    while (begin := time.perf_counter()) < end:
        await socket.send(json.dumps(_event(next(_numbers), time.time_ns()) | {"ask": True}))
        await until(socket, "decision")
        times.append((time.perf_counter() - begin) * 1000)
        await asyncio.sleep(PAUSE)
    return times


if __name__ == "__main__":
    main()
