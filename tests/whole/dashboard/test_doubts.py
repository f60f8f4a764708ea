"""What was lost, or not judged, is not called good, in the list and on the page of a session."""

from __future__ import annotations

import asyncio
import json

from playwright.async_api import Page, expect

from tests.whole.client import attached, make_clock, make_event
from tests.whole.conftest import Starts
from tests.whole.harness import run

LOST = "5 events were lost, and not judged: /a"
DEGRADED = "verdicts of a_is_small are degraded: what came before was lost, skipped, not computed or judged too early"
SILENT = "/b: no event in the recording"


async def test_a_session_that_lost_events_is_degraded(start: Starts, page: Page) -> None:
    server = start(ORACLE_HISTORY="memory")
    async with attached(server, session="lost", spec="single") as monitor:
        await monitor.send(make_event(1, data={"v": 1}), make_event(2, data={"v": 1}, lost=5))
        await monitor.acked(2)
        await page.goto(f"{server.url}/")
        kinds = page.get_by_role("toolbar", name="Kinds")
        await expect(kinds).to_contain_text("Degraded 1")
        await expect(kinds).to_contain_text("Fine 0")
        await expect(page.get_by_role("row", name="lost")).to_contain_text(LOST)
        await page.goto(f"{server.url}/#/sessions/lost")
        card = page.locator(".now .card")
        await expect(card).to_contain_text(f"Its property holds; {LOST}")
        await expect(card).to_have_attribute("data-state", "degraded")


async def test_a_session_of_which_events_were_refused_is_degraded(start: Starts, page: Page) -> None:
    server = start(ORACLE_HISTORY="memory")
    refused = "2 events were refused, unreadable or of no stream here, and not judged"
    async with attached(server, session="odd", spec="single") as monitor:
        await monitor.send(make_event(1, data={"v": 1}), make_event(2) | {"data": [1]}, make_event(3, "/nowhere"))
        await monitor.acked(3)
        await page.goto(f"{server.url}/")
        await expect(page.get_by_role("toolbar", name="Kinds")).to_contain_text("Degraded 1")
        await page.goto(f"{server.url}/#/sessions/odd")
        await expect(page.locator(".now .card")).to_contain_text(f"Its property holds; {refused}")
    assert refused in run("verdicts", "odd", "--url", server.url).stdout
    assert refused in run("close", "odd", "--url", server.url).stdout, "no event has come since that tells of a gap"


async def test_a_recording_that_lacks_a_stream_is_not_good(start: Starts, page: Page) -> None:
    server = start(ORACLE_HISTORY="memory")
    event = json.dumps(make_event(1, data={"v": 1}) | {"arrived": make_event(1)["stamp"]})
    sent = server.http.post("/api/v1/recordings", params={"spec": "bypassed", "session": "one"}, content=event)
    assert sent.status_code == 202, sent.text
    await server.until(lambda: server.get(f"recordings/{sent.json()['id']}")["state"], lambda state: state == "judged")
    assert SILENT in server.get("sessions/one")["doubts"]
    for command in (("verdicts", "one"), ("sessions",)):
        assert SILENT in run(*command, "--url", server.url).stdout
    await page.goto(f"{server.url}/")
    await expect(page.get_by_role("row", name="one")).to_contain_text(SILENT)
    recording = page.get_by_role("list", name="recordings")
    await expect(recording).to_contain_text("no violation, but see what is noted")
    await expect(recording).to_contain_text(SILENT)
    await expect(recording.locator(".good")).to_have_count(0)
    await page.goto(f"{server.url}/#/sessions/one")
    await expect(page.locator(".now .card")).to_contain_text(SILENT)
    await expect(page.locator(".now .card")).to_have_attribute("data-state", "degraded")


async def test_a_session_that_was_judged_too_early_is_degraded(start: Starts, page: Page) -> None:
    server = start(ORACLE_HISTORY="memory")
    async with (
        attached(server, "behind", session="full", spec="tiny", streams=["/b"]),
        attached(server, session="full", streams=["/a"]) as monitor,
    ):
        await monitor.send(*(make_event(i, at=i, data={"v": 1}) for i in range(1, 9)))
        await server.until(lambda: server.get("sessions/full")["counters"]["steps"], lambda steps: steps == 3)
        assert [r["degraded"] for r in server.records("full")] == [True] * 3
        assert server.get("sessions/full")["doubts"] == [DEGRADED]
        await page.goto(f"{server.url}/")
        await expect(page.get_by_role("toolbar", name="Kinds")).to_contain_text("Degraded 1")
        await page.goto(f"{server.url}/#/sessions/full")
        await expect(page.locator(".now .card")).to_have_attribute("data-state", "degraded")
        await expect(page.locator(".now .card")).to_contain_text(DEGRADED)
        await expect(page.locator(".properties tbody td:nth-child(2)")).to_have_text("✓ currently_true degraded")


async def test_who_only_reads_a_history_tells_that_something_was_lost(start: Starts, page: Page) -> None:
    server = start()
    async with attached(server, session="lost", spec="single") as monitor:
        await monitor.send(make_event(1, data={"v": 1}), make_event(2, data={"v": 1}, lost=5))
        await monitor.acked(2)
        reader = await asyncio.to_thread(start, ORACLE_READ_ONLY="1")  # the monitor answers pings meanwhile
        assert reader.get("sessions/lost")["doubts"] == [DEGRADED]
        await page.goto(f"{reader.url}/")
        await expect(page.get_by_role("toolbar", name="Kinds")).to_contain_text("Degraded 1")
        await page.goto(f"{reader.url}/#/sessions/lost")
        await expect(page.locator(".now .card")).to_have_attribute("data-state", "degraded")


async def test_what_was_lost_is_told_where_sessions_are_compared(start: Starts, page: Page) -> None:
    server = start(ORACLE_HISTORY="memory")
    for session, lost in (("sound", 0), ("lost", 5)):
        async with attached(server, session=session, spec="single") as monitor:
            await monitor.send(make_event(1, data={"v": 1}), make_event(2, data={"v": 1}, lost=lost))
            await monitor.acked(2)
    await page.goto(f"{server.url}/#/compare/sound/lost")
    await expect(page.locator(".compared .complaint")).to_have_text([f"lost: {LOST}"])


async def test_that_nothing_was_asked_of_a_property_that_holds_is_told(start: Starts, page: Page) -> None:
    server = start(ORACLE_HISTORY="memory")
    told = 'nothing was asked of moves (`{topic: "/cmd"}` never held)'
    async with attached(server, session="quiet", spec="moving") as monitor:
        await monitor.send(make_event(1, "/odom", data={"v": 1}), make_clock("/odom", 2), make_clock("/cmd", 2))
        await monitor.acked(1)
        assert told in run("verdicts", "quiet", "--url", server.url).stdout
        assert 'oracle_unasked{property="moves",spec="moving"} 1.0' in server.http.get("/metrics").text
        await page.goto(f"{server.url}/#/sessions/quiet")
        card = page.locator(".now .card")
        await expect(card).to_contain_text("nothing was asked of moves")
        await expect(page.locator(".unasked")).to_have_text('nothing was asked of it: {topic: "/cmd"} never held')
        await monitor.send(make_event(2, "/cmd", 3), make_clock("/odom", 4), make_clock("/cmd", 4))
        await monitor.acked(2)
        await expect(page.locator(".unasked")).to_have_count(0)
        await expect(card).not_to_contain_text("nothing was asked")
        assert "nothing was asked" not in run("close", "quiet", "--url", server.url).stdout


OWED = """
id: owed
ordering: {max_delay: none}
streams: [{topic: /ask}, {topic: /answer}]
properties:
  - {id: answered, formula: '{topic: /ask} -> eventually {topic: /answer}'}
"""


async def test_what_never_came_is_not_said_to_hold_once_nothing_comes_any_more(start: Starts, page: Page) -> None:
    server = start(ORACLE_HISTORY="memory")
    server.http.put("/api/v1/specs/owed", content=OWED).raise_for_status()
    card = page.locator(".now .card")
    async with attached(server, session="s", spec="owed") as monitor:
        await monitor.send(make_event(1, "/ask"), make_event(2, "/ask", at=1))
        await monitor.send(make_clock("/ask", at=2), make_clock("/answer", at=2))
        await monitor.acked(2)
        await page.goto(f"{server.url}/#/sessions/s")
        await expect(card).to_have_attribute("data-state", "hold")
        await monitor.detach()
    await expect(card).to_contain_text("Its property held at the newest step; 2 obligations still open: answered; no ")
    server.http.delete("/api/v1/sessions/s")
    await expect(card).to_contain_text("Its property holds at the end; 2 obligations still open: answered")
    await expect(card).to_have_attribute("data-state", "undecided")
