"""What a page does not know, or does not show, it calls neither good nor none."""

from __future__ import annotations

import re
import time
from pathlib import Path

from playwright.async_api import Page, expect

from tests.whole.client import BASE, attached, make_clock, make_event, make_events
from tests.whole.conftest import Starts
from tests.whole.harness import Server
from tests.whole.test_disk import locked
from tests.whole.test_recordings import judged, log

BOTH = """
id: both_orders
ordering: {by: both, max_delay: 60s}
streams:
  - {topic: /x, signals: {x: msg.x}}
  - {topic: /y, signals: {y: msg.y}}
properties:
  - {id: p, formula: 'historically ({x: 1} -> once {y: 1})'}
"""
REVISING = """
id: told_late
ordering: {max_delay: 0s, late: revise, horizon: 1h}
streams:
  - {topic: /x, signals: {x: msg.x}}
  - {topic: /y, signals: {y: msg.y}}
properties:
  - {id: p, formula: '{x: 1} -> once {y: 1}'}
"""
TIMES = """
id: other
streams:
  - {topic: /a, signals: {v: msg.v}}
properties:
  - {id: a_is_small, formula: 'not {topic: "/a", v > 5}'}
"""

APART = TIMES.replace("id: other", "id: apart\nepisodes: {gap: 0s}")
"""Each violation is an episode."""


def put(server: Server, text: str) -> str:
    """Store a spec; its id."""
    name = text.split("id: ", 1)[1].split("\n", 1)[0]
    assert server.http.put(f"/api/v1/specs/{name}", content=text).is_success
    return name


async def test_a_row_tells_what_the_order_says_that_decides(start: Starts, page: Page) -> None:
    server = start()
    async with (
        attached(server, "m1", session="s", spec=put(server, BOTH), streams=["/x"]) as x,
        attached(server, "m2", session="s", streams=["/y"]) as y,
    ):
        await y.send(make_event(1, "/y", at=9, data={"y": 1}))
        await y.acked(0)
        await server.until(lambda: server.get("sessions/s")["counters"]["held"], bool)
        await x.send(make_event(1, "/x", at=1, data={"x": 1}), make_clock("/x", at=99))
        await y.send(make_clock("/y", at=99))
        await server.until(lambda: server.get("sessions/s")["properties"][0]["violations"], bool)
        assert [p["outcome"] for p in server.get("sessions/s")["properties"]] == ["false", "true"]
        await page.goto(f"{server.url}/#/sessions/s")
        row = page.locator(".lane.property")
        await expect(row.locator(".value")).to_have_text(re.compile("✘ for"))
        await expect(row.locator("button")).to_have_attribute("aria-label", re.compile("p: false; failed .* to now"))


async def test_one_violation_that_stands_is_not_hidden_by_many_that_were_retracted(start: Starts, page: Page) -> None:
    server = start()
    async with attached(server, session="s", spec=put(server, REVISING)) as monitor:
        risen = [make_event(2 * i + 1, "/x", at=1000 * i, data={"x": 1}) for i in range(31)]
        fallen = [make_event(2 * i + 2, "/x", at=1000 * i + 500, data={"x": 0}) for i in range(31)]
        await monitor.send(make_events(*[each for pair in zip(risen, fallen, strict=True) for each in pair]))
        await monitor.acked(62)
        await monitor.send(make_event(63, "/y", at=700, data={"y": 1}))
        await monitor.acked(63)
        await server.until(lambda: server.get("sessions/s")["properties"][0]["violations"], lambda many: many == 1)
        await page.goto(f"{server.url}/#/sessions/s")
        violations = page.get_by_role("region", name="violations")
        await expect(violations).to_contain_text("retracted")
        await violations.get_by_role("button", name="Older ones").click()
        await expect(violations.locator("li:not(.retracted)")).to_have_count(1)
        await expect(violations.locator("li.retracted")).to_have_count(30)


async def test_what_retention_has_deleted_was_there(start: Starts, page: Page) -> None:
    server = start(ORACLE_RETAIN_CHECK="0.05", ORACLE_RETAIN_EVENTS="100")
    async with attached(server, session="s", spec="single") as monitor:
        events = [make_event(n, at=n, data={"v": 99 if n == 5 else 1}) for n in range(1, 1001)]
        await monitor.send(make_events(*events[:500]), make_events(*events[500:]))
        await monitor.acked(1000)
        await server.until(lambda: server.records("s", order="asc", limit=1)[0]["n"], lambda first: first > 5)
        await server.until(lambda: server.get("sessions/s/episodes")["items"], lambda found: not found)
        await page.goto(f"{server.url}/#/sessions/s")
        await expect(page.locator(".now .card")).to_contain_text("Its property holds · its violations are kept no more")
        for name in ("episodes", "violations"):
            none = page.get_by_role("region", name=name)
            await expect(none).to_contain_text("Those that there were are kept no more.")
        asked: list[str] = []
        page.on(
            "request", lambda sent: asked.append(sent.url) if sent.url.endswith("/verdicts/5/explanation") else None
        )
        await page.goto(f"{server.url}/#/sessions/s?n=5")
        await expect(page.locator(".verdict")).to_contain_text("verdict 5 of session 's' is not kept any more")
        async with page.expect_response(lambda answer: "/timeline" in answer.url):  # the page is refreshed
            await monitor.send(make_event(1001, at=2000, data={"v": 1}))
        assert len(asked) == 1, "what is gone is asked for once"


async def test_that_there_are_more_violations_than_are_listed_is_told(server: Server, session: str, page: Page) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        events = [make_event(n, at=n, data={"v": 99 if n % 2 else 1}) for n in range(1, 2203)]
        for first in range(0, len(events), 500):
            await monitor.send(make_events(*events[first : first + 500]))
        await monitor.acked(len(events))
    violations = page.get_by_role("region", name="violations")
    await page.goto(f"{server.url}/#/sessions/{session}")
    for listed in (20, 40, 80, 160, 320, 640):
        await expect(violations.locator("li")).to_have_count(listed)
        await violations.get_by_role("button", name="Older ones").click()
    await expect(violations.locator("li")).to_have_count(1000)
    await expect(violations).to_contain_text("Of the newest 1000; there are older ones.")


async def test_that_it_failed_before_is_found_among_many_of_another_spec(start: Starts, page: Page) -> None:
    server = start()
    other = put(server, TIMES)
    for session, spec, many in (("mine", "single", 3), ("theirs", other, 105)):
        async with attached(server, session=session, spec=spec) as monitor:
            shift = 0 if session == "mine" else 10**7
            events = [
                make_event(n, at=shift + 2000 * n, data={"v": 99 if n % 2 else 1}) for n in range(1, 2 * many + 1)
            ]
            await monitor.send(make_events(*events))
            await monitor.acked(2 * many)
    async with attached(server, session="mine", spec="single") as monitor:
        last = BASE // 10**6 + 10**8
        await monitor.send(make_event(7, at=last - BASE // 10**6, data={"v": 99}))
        await monitor.acked(7)
        await page.goto(f"{server.url}/#/sessions/mine?n=7")
        before = page.get_by_role("region", name="Before")
        await expect(before).to_contain_text("3 in this session, it is not known how many in others")
        await expect(before.locator("li")).to_have_count(3)


async def test_a_noisy_robot_hides_no_other(start: Starts, page: Page) -> None:
    server = start()
    now = time.time_ns()
    for session, many, ago in (("quiet", 1, 1800), ("noisy", 1005, 600)):
        began = (now - BASE) // 10**6 - ago * 1000
        events = [make_event(n, at=began + n, data={"v": 99 if n % 2 else 1}) for n in range(1, 2 * many + 1)]
        async with attached(server, session=session, spec=put(server, APART)) as monitor:
            for first in range(0, len(events), 500):
                await monitor.send(make_events(*events[first : first + 500]))
            await monitor.acked(len(events))
    await server.until(lambda: len(server.get("episodes", limit=1000)["items"]), lambda many: many == 1000)
    await page.goto(f"{server.url}/#/")
    await expect(page.locator(".sessions tr.group")).to_have_count(1)
    await expect(page.locator(".sessions tr.group")).to_have_text("Wrong within the hour")
    quiet = page.get_by_role("row", name="quiet")
    await expect(quiet).to_contain_text("a_is_small")
    await expect(quiet).to_contain_text("30 min ago")


async def test_violations_that_are_over_are_told_of_recordings_and_simulations(
    server: Server, session: str, page: Page, tmp_path: Path
) -> None:
    await judged(server, log(tmp_path / "log.jsonl", 20), "single", session=session)
    async with attached(server, session=f"{session}-sim", spec="single", clock="sim") as monitor:
        await monitor.send(make_clock("/a", at=0))
        await monitor.send(*(make_event(i, at=i, data={"v": 99 if i == 2 else 1}) for i in range(1, 4)))
        await monitor.acked(3)
        await page.goto(f"{server.url}/#/?q={session}")
        wrong = page.locator(".sessions td:nth-child(2)")
        await expect(wrong).to_have_text(["1 violation before", "2 violations before"])


async def test_what_is_judged_in_part_alone_is_not_said_to_hold(
    server: Server, session: str, page: Page, tmp_path: Path
) -> None:
    path = log(tmp_path / "log.jsonl", 20)
    path.write_text(path.read_text(encoding="utf-8") + "{\n", encoding="utf-8")
    await judged(server, path, "single", session=session, state="failed")
    await page.goto(f"{server.url}/#/?q={session}")
    await expect(page.locator(".sessions td:nth-child(2)")).to_contain_text(
        re.compile("incomplete.*2 violations before")
    )
    await page.goto(f"{server.url}/#/sessions/{session}")
    card = page.locator(".now .card").first
    await expect(card).to_contain_text("Its property holds at the end as far as is known")
    await expect(card).to_have_attribute("data-state", "not known")


async def test_sessions_whose_episodes_are_gone_are_not_called_alike(start: Starts, page: Page) -> None:
    server = start(ORACLE_RETAIN_CHECK="0.05", ORACLE_RETAIN_EVENTS="300")
    for session, wrong in (("failed", 5), ("sound", None)):
        async with attached(server, session=session, spec="single") as monitor:
            await monitor.send(
                make_events(*(make_event(n, at=n, data={"v": 99 if n == wrong else 1}) for n in range(1, 601)))
            )
            await monitor.acked(600)
    await server.until(lambda: server.get("sessions/failed/episodes")["items"], lambda found: not found)
    await page.goto(server.url)
    for session, told in (
        ("failed", "no episode that is kept in the last hour"),
        ("sound", "no episode in the last hour"),
    ):
        hour = page.get_by_role("row", name=session).locator("td:nth-child(4) div")
        await expect(hour).to_have_attribute("title", told)
    await page.goto(f"{server.url}/#/compare/failed/sound")
    compared = page.locator("section.compared")
    await expect(compared).to_contain_text("Not all episodes of failed are kept any more")
    await expect(compared).not_to_contain_text("No episode differs")
    await page.goto(f"{server.url}/#/compare/sound/sound")
    await expect(compared).to_contain_text("No episode differs")
    await expect(compared.locator(".complaint")).to_have_count(0)


async def test_what_can_not_be_kept_yet_is_not_called_kept_no_more(start: Starts, page: Page) -> None:
    """And it is read once it is kept, though nothing else has changed by then."""
    server, asked = start(), list[str]()
    page.on("request", lambda sent: asked.append(sent.url) if "/s/violations" in sent.url else None)
    violations = page.get_by_role("region", name="violations")
    async with attached(server, session="s", spec="single") as monitor:
        with locked(server):
            await monitor.send(make_event(1, data={"v": 99}))
            await page.goto(f"{server.url}/#/sessions/s")
            await expect(page.get_by_text("nothing of it is judged while the history can't be written")).to_be_visible()
            asked.clear()
            await violations.scroll_into_view_if_needed()
            await expect(violations).to_contain_text("None that is kept.")
            await expect(page.locator(".now .card")).not_to_contain_text("kept no more")
            while len(asked) < 9:  # so often the page looks whether it is there by now
                await page.wait_for_event("request", lambda sent: "/s/violations" in sent.url)
        await expect(violations.locator("li")).to_have_count(1)
        await expect(page.locator(".now .card.open")).to_contain_text("fails")
