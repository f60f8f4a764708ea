"""Why any verdict of a history is as it is."""

from __future__ import annotations

import asyncio
import contextlib
import sqlite3
import subprocess
from collections.abc import AsyncGenerator
from pathlib import Path
from typing import Any

import httpx
import pytest

from oracle_server.history.records import StoredStep
from oracle_server.history.sqlite.history import SqliteHistory
from oracle_server.review.again import NoExplanationError
from oracle_server.review.explanation import explained
from tests.chaos.served import Served
from tests.whole.client import attached, make_clock, make_event, make_events
from tests.whole.conftest import Starts
from tests.whole.harness import COMMAND, PATIENCE, Server, environment


def explanation(server: Server, n: int) -> dict[str, Any]:
    found: dict[str, Any] = server.get(f"sessions/s/verdicts/{n}/explanation")
    return found


def leaves(reasons: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [leaf for r in reasons for leaf in (leaves(r["reasons"]) if "reasons" in r else [r])]


def number(server: Server, step: int, name: str) -> int:
    (found,) = [r["n"] for r in server.records("s") if r["step"] == step and r["property"] == name]
    return int(found)


async def tell(server: Server) -> None:
    async with attached(server, session="s", spec="explained") as monitor:
        await monitor.send(
            make_event(1, "/grant", at=1, data={"id": 7, "mode": "on"}),
            make_event(2, "/ask", at=2, data={"id": 7}),
            make_event(3, "/go", at=3, kind="request", data={"v": 9}, ask=True, call=1),
            make_event(4, "/grant", at=4, data={"id": 8, "mode": "off"}),
            make_event(5, "/ask", at=5, data={"id": 1}),
            make_event(6, "/ask", at=6, data={"id": 1}),
        )
        await monitor.acked(6)


async def test_positive_and_negative_verdicts_are_explained_down_to_their_events(start: Starts) -> None:
    server = start()
    await tell(server)
    positive = explanation(server, number(server, 2, "granted_in_time"))
    assert positive["outcome"] == "currently_true"
    assert "granted_in_time holds at step 2" in positive["explanation"]["text"]

    first = explanation(server, number(server, 4, "granted_in_time"))
    assert first["outcome"] == "false"
    assert first["explanation"]["event"]["seq"] == 5
    (nested,) = first["explanation"]["reasons"]
    found = {leaf["formula"]: leaf for leaf in leaves([nested])}
    asked = found['{topic: "/ask", id: 1}']
    assert asked["event"]["signals"]["id"] == 1
    assert asked["event"]["seq"] == 5
    assert found['{topic: "/grant", id: 1}']["window"] == [1, 4], "the denied request never happened"

    (live,) = [r for r in server.records("s", "violations") if r["property"] == "granted_in_time"]
    assert live == first, "as it was told when it came"

    later = explanation(server, number(server, 5, "granted_in_time"))
    assert later["explanation"] == first["explanation"], "explained by what made it final"

    other = explanation(server, number(server, 5, "asked_before"))
    (leaf,) = leaves(other["explanation"]["reasons"])
    assert (other["outcome"], leaf["event"]["seq"]) == ("true", 5)

    denied = next(r["n"] for r in server.records("s") if r["seq"] == 3 and r["property"] == "go_small")
    assert "does not hold" in explanation(server, denied)["explanation"]["text"]


async def test_what_reelay_judges_is_explained_too(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="reelay") as monitor:
        await monitor.send(make_event(1, data={"v": 1}), make_event(2, at=1, data={"v": 2}))
        await monitor.acked(2)
    (leaf,) = leaves(explanation(server, number(server, 2, "a_was_1"))["explanation"]["reasons"])
    assert (leaf["formula"], leaf["event"]["seq"]) == ('once {topic: "/a", v: 1}', 1)
    assert explanation(server, number(server, 2, "a_is_small"))["outcome"] == "currently_true"


async def test_a_deadline_that_ran_out_is_explained(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="timed") as monitor:
        await monitor.send(make_event(1, "/a", at=0), make_clock("/a", 60), make_clock("/b", 60))
        (told,) = await monitor.violated(1)
        await monitor.acked(1)
    assert explanation(server, told["n"])["explanation"] == told["explanation"]
    beside = next(r["n"] for r in server.records("s") if r["kind"] == "tick" and r["property"] == "steps")
    assert explanation(server, beside)["explanation"]["event"]["seq"] == 1, "a tick is no step"


async def test_what_cannot_be_explained_is_said(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="explained") as monitor:
        await monitor.send(make_event(1, "/ask", data={"id": [1]}))
        await monitor.acked(1)
    for n, status, detail in (
        (1, 409, "verdict 1 is no judgement: computing failed for id"),
        (1000, 404, "session 's' has no verdict 1000 in its history yet"),
    ):
        answer = server.http.get(f"/api/v1/sessions/s/verdicts/{n}/explanation")
        assert (answer.status_code, answer.json()["detail"]) == (status, detail)


class Pruned(SqliteHistory):
    """A history of which something goes while it is read."""

    going = "false"

    async def steps(self, session: int, after: int, upto: int | None = None) -> AsyncGenerator[list[StoredStep], None]:
        with contextlib.closing(sqlite3.connect(self.path)) as database, database:
            database.execute(f"DELETE FROM steps WHERE {self.going}")
        async for page in super().steps(session, after, upto):
            yield page


@pytest.mark.parametrize("going", ["position < 3", "true"])
async def test_what_goes_while_it_is_explained_is_not_explained_without_it(start: Starts, going: str) -> None:
    server = start()
    await tell(server)
    n = number(server, 4, "granted_in_time")
    assert server.stop() == 0
    with contextlib.closing(Pruned(server.data)) as history:
        assert await explained(history, 1, n) is not None
        history.going = going
        with pytest.raises(NoExplanationError, match="not kept any more"):
            await explained(history, 1, n)


async def test_an_explanation_survives_a_restart_and_is_printed_as_a_tree(start: Starts) -> None:
    server = start()
    await tell(server)
    n = number(server, 4, "granted_in_time")
    before = explanation(server, n)
    server.stop()
    server = start()
    assert explanation(server, n) == before
    printed = subprocess.run(
        [COMMAND, "verdicts", "s", "--explain", str(n), "--url", server.url],
        capture_output=True, text=True, check=True, env=environment(),
    ).stdout  # fmt: skip
    lines = [line.strip() for line in printed.splitlines()]
    assert lines[0].startswith("granted_in_time is false at step 4 (")
    assert "), decided by /ask (topic 5 of " in lines[0]
    assert lines[0].endswith(f" (#{n})")
    assert '{topic: "/grant", id: 1}: held at none of steps 1–4' in lines  # noqa: RUF001 -- a range


UNDOING = """
id: undoing
ordering: {max_delay: none}
streams:
  - topic: /a
  - topic: /go
    action: filter
    on_deny: undo
    signals: {v: msg.v}
properties:
  - id: fresh
    time: seconds
    formula: 'once[:5ms] {topic: "/a"} or {topic: "/go", v: 77}'
  - id: small
    formula: 'not {v > 3}'
    guards: [/go]
"""


async def test_a_deadline_after_an_attempt_that_was_undone_is_not_explained_by_it(start: Starts) -> None:
    server = start()
    assert server.http.put("/api/v1/specs/undoing", content=UNDOING).is_success
    async with attached(server, session="s", spec="undoing") as monitor:
        await monitor.send(make_event(1, "/a", at=0), make_clock("/go", 1))
        await monitor.send(make_event(2, "/go", at=2, data={"v": 9}, ask=True), make_clock("/a", 10))
        assert (await monitor.expect("decision", seq=2))["decision"] == "deny"
        await monitor.send(make_clock("/go", 10))
        await monitor.violated(2)
    *_, tick = server.records("s", property="small")
    assert (tick["kind"], tick["outcome"]) == ("tick", "currently_true")
    found = explanation(server, tick["n"])
    assert found["explanation"]["text"].startswith("small holds at step 1 (00:00:00.000Z), /a")


SLOW = """
import time
from types import SimpleNamespace
from oracle_server.review import again

def slow(_):
    with open({steps!r}, "ab") as file:
        file.write(b".")
    time.sleep(0.02)

again.time = SimpleNamespace(sleep=slow)
"""
"""Makes each step of an explanation slow, and counts them in a file."""

STEPS = 1000


async def test_an_explanation_ends_when_its_client_leaves(start: Starts, tmp_path: Path) -> None:
    server = start()
    async with attached(server, session="s", spec="single") as monitor:
        await monitor.send(make_events(*(make_event(i, at=i, data={"v": 1}) for i in range(1, STEPS + 1))))
        await monitor.acked(STEPS)
    assert server.stop() == 0
    steps = tmp_path / "steps"
    async with (
        Served(server.specs, server.data, SLOW.format(steps=str(steps))) as served,
        httpx.AsyncClient(base_url=served.url, timeout=PATIENCE, trust_env=False) as http,
    ):
        impatient = asyncio.create_task(http.get(f"/api/v1/sessions/s/verdicts/{STEPS}/explanation"))
        await server.until(steps.exists, bool)
        impatient.cancel()
        answer = await http.get("/api/v1/sessions/s/verdicts/1/explanation")
        assert (answer.status_code, answer.json()["n"]) == (200, 1)
        assert steps.stat().st_size < STEPS
