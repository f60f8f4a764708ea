"""What a page that is left open costs the network, and what it shows meanwhile."""

from __future__ import annotations

import asyncio
import re
from collections import Counter

from playwright.async_api import Page, Response, expect

from tests.whole.client import attached, make_event, make_events
from tests.whole.harness import PATIENCE, Server

RATE, BEFORE = 1000, 20
"""Events of each second while it is watched, of which the page asks once, and before."""
ROUNDS = 14
MOST = 20_000
"""Bytes a second."""


def second(number: int, rate: int, seq: int) -> dict[str, object]:
    """The events of one second: those of each fifth one violate one of the thirty properties for a while."""
    data = [{"v": 27 if number % 5 == 4 and 5 * i < rate else 100 + i % 50} for i in range(rate)]
    at = [1000 * (number + i / rate) for i in range(rate)]
    return make_events(*(make_event(seq + i, at=at[i], data=data[i]) for i in range(rate)))


async def test_a_live_page_of_thirty_properties_asks_for_little(server: Server, session: str, page: Page) -> None:
    costs: Counter[int] = Counter()
    asked = asyncio.Condition()
    round_ = 0

    async def count(answer: Response) -> None:
        nonlocal round_
        async with asked:
            round_ += answer.url.endswith(f"/sessions/{session}")
            costs[round_] += int(await answer.header_value("content-length") or 0)
            asked.notify_all()

    counting: set[asyncio.Task[None]] = set()
    page.on("response", lambda answer: counting.add(asyncio.create_task(count(answer))))
    async with attached(server, session=session, spec="thirty") as monitor:
        for number in range(60):
            await monitor.send(second(number, BEFORE, number * BEFORE + 1))
        sent = 60 * BEFORE
        await monitor.acked(sent)
        await page.goto(f"{server.url}/#/sessions/{session}")
        await expect(page.get_by_role("button", name="29 properties hold in all of this time")).to_be_visible()
        begin = round_
        for number in range(60, 60 + ROUNDS):
            before = round_
            await monitor.send(second(number, RATE, sent + 1))
            sent += RATE
            await monitor.acked(sent)
            await page.evaluate("document.dispatchEvent(new Event('visibilitychange'))")  # it asks at once
            async with asyncio.timeout(PATIENCE), asked:
                await asked.wait_for(lambda before=before: round_ > before)  # type: ignore[misc]
        until = round_
        violated = page.locator(".lane.property:not(.fold) .value")
        await expect(violated).to_have_text(re.compile(rf" {(60 + ROUNDS) // 5} violations$"))
        await page.locator(".time").get_by_role("button", name="10 s", exact=True).click()
        await expect(page.locator(".lane.stream .value")).to_have_text(re.compile(r"^(99\d|100\d) Hz$"))
        told = sum(costs[each] for each in range(begin + 1, until))
    assert told / (until - begin - 1) <= MOST
    assert all(size <= 2 * MOST for each, size in costs.items() if begin < each < until), "nor much at once"
