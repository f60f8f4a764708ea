"""What monitors, and people beside a robot, are told where verdicts are revised."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

from oracle_adapter.board import Board

from tests.whole.client import Monitor, attached, make_clock, make_event
from tests.whole.harness import Server, run
from tests.whole.test_recorded import comparable

WORDS = "moves is not violated at step 2 (00:00:00.100Z) (#2): /odom (topic 3 of m1) came "


class Screen:
    """Keeps the errors."""

    def __init__(self) -> None:
        self.errors: list[str] = []

    def error(self, text: str) -> None:
        self.errors.append(text)

    def __getattr__(self, name: str) -> Any:
        return lambda *_: None


async def stand_still(monitor: Monitor) -> None:
    """A command at 100 ms, which breaks the property: the robot stood still at 0 ms."""
    await monitor.send(make_event(1, "/odom", data={"v": 0}), make_event(2, "/cmd", at=100))
    await monitor.send(make_clock("/odom", 200), make_clock("/cmd", 200))


async def move(monitor: Monitor) -> None:
    """The odometry of 50 ms comes late: the robot moved before the command."""
    await monitor.send(make_event(3, "/odom", at=50, data={"v": 1}))


async def test_who_asks_is_told_what_is_revised_and_others_what_they_always_were(server: Server, session: str) -> None:
    async with (
        attached(server, "m1", session=session, spec="moving", features=["revisions"]) as new,
        attached(server, "m2", session=session, streams=[]) as old,
    ):
        await stand_still(new)
        violation = await new.expect("violation")
        assert await old.expect("violation") == violation
        await move(new)
        revision = await new.expect("revision", n=4, revises={"from": 2, "to": 2}, retracted=True)
        await new.send(make_event(4, "/odom", at=60, data={"v": 0}))
        appears = await new.expect("revision", violation=True)
        assert await new.expect("violation") == {**appears, "type": "violation"}
        assert await old.expect("violation") == {**appears, "type": "violation"}
    shown = server.records(session, **{"as": "all"})
    assert {**revision, "type": None} in [{**row, "type": None} for row in shown]


async def test_how_properties_stand_goes_by_what_stands(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="moving", verdicts=True) as monitor:
        assert (await monitor.expect("verdicts"))["worst"] == "unknown"
        await stand_still(monitor)
        assert (await monitor.expect("verdicts"))["properties"]["moves"]["violations"] == 1
        await move(monitor)
        told = (await monitor.expect("verdicts"))["properties"]["moves"]
        assert (told["outcome"], told["level"], told["violations"]) == ("currently_true", "ok", 0)
        assert told["first_violation"] is None


async def test_people_are_told_what_was_taken_back_on_the_robot_and_in_the_log(server: Server, session: str) -> None:
    screen = Screen()
    board = Board("m1", screen)
    async with attached(server, session=session, spec="moving", features=["revisions"]) as monitor:
        board.on_state("attached", session)
        await stand_still(monitor)
        board.on_violation(await monitor.expect("violation"))
        await move(monitor)
        board.on_revision(await monitor.expect("revision"))
    assert screen.errors[1].startswith(f"retracted: {WORDS}")
    said = server.said(rf"retracted: moves is not violated at verdict #2: [^\n]* late [^\n]*session={session}")[0]
    assert "/odom (topic 3 of m1) came " in said


async def test_the_replay_of_a_trace_tells_what_stands_and_what_was_said(
    server: Server, session: str, tmp_path: Path
) -> None:
    async with attached(server, session=session, spec="moving") as monitor:
        await stand_still(monitor)
        await move(monitor)
        await monitor.acked(3)
    server.http.delete(f"/api/v1/sessions/{session}")
    out = tmp_path / "session.jsonl"
    assert (await asyncio.to_thread(run, "record", session, "-o", out, "--url", server.url)).returncode == 0
    spec = Path(__file__).parent / "specs" / "moving.yaml"
    for view in ("standing", "first", "all"):
        told = await asyncio.to_thread(run, "replay", spec, out, "--json", "--as", view)
        *records, last = map(json.loads, told.stdout.splitlines())
        assert comparable(records) == comparable(server.records(session, **{"as": view}))
        assert (told.returncode, last["summary"]["violations"], last["summary"]["retracted"]) == (0, 0, 1)
