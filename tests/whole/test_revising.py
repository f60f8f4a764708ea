"""A message that comes late puts the verdicts right: what stands, what was said at first, and why."""

from __future__ import annotations

import re
import signal
import sqlite3
from contextlib import closing
from typing import Any

from tests.whole.client import Monitor, attached, make_clock, make_event
from tests.whole.conftest import Starts
from tests.whole.harness import Server, run
from tests.whole.test_stream import stream, take


async def put_right(monitor: Monitor) -> None:
    """A violation at the third event, whose cause comes as the fourth."""
    for seq, name, at, v in ((1, "/a", 0, 1), (2, "/b", 10, 1), (3, "/b", 500, 2)):
        await monitor.send(make_event(seq, name, at=at, data={"v": v}))
        await monitor.acked(seq)
    await monitor.violated(1)
    await monitor.send(make_event(4, "/a", at=400, data={"v": 2}))
    await monitor.acked(4)


def told(records: list[dict[str, Any]]) -> list[tuple[Any, ...]]:
    return [(r["n"], r["kind"], r["step"], r.get("place"), r["outcome"], r["violation"]) for r in records]


async def test_what_stands_is_what_the_order_of_publication_gives(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="revising") as monitor, stream(server, session) as events:
        await put_right(monitor)
        follows = await take(events, 5)
        state = server.get(f"sessions/{session}")
    first = server.records(session, **{"as": "first"})
    assert told(first) == [
        (1, "topic", 1, None, "currently_true", False), (2, "topic", 2, None, "currently_true", False),
        (3, "topic", 3, None, "currently_false", True), (4, "topic", 4, 3, "currently_true", False),
    ]  # fmt: skip
    stands = server.records(session)
    assert [(r["n"], r["outcome"], r.get("revised")) for r in stands] == [
        (1, "currently_true", None), (2, "currently_true", None), (3, "currently_true", 5), (4, "currently_true", None),
    ]  # fmt: skip
    *said, revision = server.records(session, **{"as": "all"})
    assert said == first
    assert (revision["kind"], revision["revises"], revision["retracted"]) == ("revision", {"from": 3, "to": 3}, True)
    assert [(cause["monitor"], cause["seq"], cause["stream"]) for cause in revision["because"]] == [("m1", 4, "/a")]
    assert [r["n"] for r in server.records(session, "violations", **{"as": "first"})] == [3]
    assert server.records(session, "violations") == []
    assert follows[-1] == revision
    (standing,) = state["properties"]
    assert (standing["violations"], standing["first_violation"], standing["outcome"]) == (0, None, "currently_true")
    assert (state["counters"]["revised"], state["counters"]["steps"]) == (1, 4)
    assert (state["revising"]["placed"], state["revising"]["passes"], state["revising"]["going"]) == (1, 1, False)
    counted = re.search(r"^oracle_retracted_total (\S+)$", server.http.get("/metrics").text, re.MULTILINE)
    assert counted is not None
    assert float(counted[1]) >= 1, "other sessions of the server have some, too"


async def test_streams_that_were_not_heard_are_named_until_the_horizon_has_passed(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="revising") as monitor:
        await put_right(monitor)
        records = server.records(session)
        assert [r.get("unheard") for r in records] == [["/b"], ["/a"], ["/a"], None]
        assert [r["released"] for r in records[:3]] == ["max_delay"] * 3
        await monitor.send(make_event(5, "/a", at=60_200, data={"v": 3}))
        await monitor.acked(5)
        unheard = [r.get("unheard") for r in server.records(session)]
        assert unheard == [None, None, ["/a"], None, ["/b"]], "60 s after the second one"
    server.http.delete(f"/api/v1/sessions/{session}")
    assert not any("unheard" in record for record in server.records(session))


async def test_the_command_line_tells_all_three(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="revising") as monitor:
        await put_right(monitor)
    for view, lines in (("standing", 2), ("first", 7), ("all", 9)):
        shown = run("verdicts", session, "--as", view, "--url", server.url)
        assert (shown.returncode, shown.stderr) == (0, "")
        assert len(shown.stdout.splitlines()) == lines, shown.stdout
    last = run("verdicts", session, "--as", "all", "--url", server.url).stdout.splitlines()[-1]
    assert last.startswith("retracted: b_after_a is not violated at verdict #3: /a (topic 4 of m1) came ")
    assert "--as" in run("verdicts", session, "--as", "was", "--url", server.url).stderr


async def test_a_late_event_that_is_acked_has_put_the_verdicts_right_for_good(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="revising") as monitor:
        await put_right(monitor)
        server.stop(signal.SIGKILL)
    with closing(sqlite3.connect(server.data / "history.sqlite")) as database:
        rows = database.execute("SELECT position, kind, seq, place, standing FROM steps ORDER BY position").fetchall()
    assert rows[2:] == [(3, "topic", 3, None, "t"), (4, "topic", 4, 3, None), (5, "revision", -5, None, None)]


async def test_what_stands_is_explained_by_what_came_late(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="revising") as monitor:
        await put_right(monitor)
        explained = f"sessions/{session}/verdicts/3/explanation"
        stands, said = server.get(explained), server.get(explained, **{"as": "first"})
        late = server.get(f"sessions/{session}/verdicts/4/explanation")
    assert (stands["outcome"], said["outcome"]) == ("currently_true", "currently_false")
    assert 4 in seqs(stands["explanation"]["reasons"])
    assert said["explanation"]["text"].startswith("b_after_a does not hold at step 3 ")
    assert 4 not in seqs(said["explanation"]["reasons"])
    assert late["explanation"]["event"]["seq"] == 4
    assert "which came late" in late["explanation"]["text"]


def seqs(reasons: list[dict[str, Any]]) -> set[int]:
    """The numbers of the events that reasons name."""
    found = {reason["event"]["seq"] for reason in reasons if reason.get("event")}
    return found.union(*(seqs(reason.get("reasons", [])) for reason in reasons))


async def test_a_session_counts_on_over_restarts(start: Starts) -> None:
    for turn, number in enumerate((signal.SIGTERM, signal.SIGKILL, signal.SIGTERM)):
        server, times = start(ORACLE_RESUME_WITHIN="3600"), turn + 1
        async with attached(server, session="s", spec="counted") as monitor:
            await one_of_each(monitor, 3 * turn, at=1_000 * turn)
            counted = counts(server)
            server.stop(number)
        assert counted == (times, 2 * times, times, 2 * times, {"/a": (times, 2 * times), "/b": (0, 0)})
    server = start()
    assert counts(server) == counted
    ticks = [r["seq"] for r in server.records("s", property="recent", **{"as": "first"}) if r["kind"] == "tick"]
    assert ticks == list(range(1, 7))


async def one_of_each(monitor: Monitor, seq: int, at: int) -> None:
    """An event before which two were lost, one that is denied, and one that comes late, with deadlines after both."""
    await monitor.send(make_event(seq + 1, "/a", at=at, lost=2), make_clock("/a", at=at + 20))
    assert (await monitor.ask(seq + 2, stream="/b", at=at + 10, data={"v": 2}))["decision"] == "deny"
    await monitor.send(make_clock("/a", at=at + 200), make_clock("/b", at=at + 200))
    await monitor.acked(seq + 2)
    await monitor.send(make_event(seq + 3, "/a", at=at + 5))
    await monitor.acked(seq + 3)


def counts(server: Server) -> tuple[Any, ...]:
    state = server.get("sessions/s")
    streams = {stream["stream"]: (stream["late"], stream["lost"]) for stream in state["streams"]}
    return *(state["counters"][name] for name in ("late", "lost", "denied", "revised")), streams
