"""Sessions at a centre of which nothing more comes, since the robot has deleted them, or is not heard any more."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from functools import partial
from operator import eq
from pathlib import Path
from typing import Any

import pytest

from tests.history.backends import postgres
from tests.postgres import Postgres
from tests.processes import eventually
from tests.whole.client import attached, connected, make_attach, make_event
from tests.whole.conftest import copy_specs
from tests.whole.harness import Server, problem

__all__ = ["postgres"]

AT_ONCE = {"ORACLE_RETAIN_CHECK": "0.1"}


@pytest.fixture
def url(postgres: Postgres) -> str:
    return postgres.empty()


@pytest.fixture
def specs(tmp_path: Path) -> Path:
    return copy_specs(tmp_path / "specs")


@pytest.fixture
def centre(url: str, specs: Path, tmp_path: Path) -> Iterator[Server]:
    with Server(specs, tmp_path / "centre", ORACLE_HISTORY=url, **AT_ONCE) as server:
        yield server


async def drive(server: Server, *values: int, first: int = 1) -> None:
    async with attached(server, session="s1", spec="single") as monitor:
        for seq, v in enumerate(values, first):
            await monitor.send(make_event(seq, at=seq, data={"v": v}))
        await monitor.acked(first + len(values) - 1)


def close(server: Server, name: str) -> None:
    server.http.delete(f"/api/v1/sessions/{name}").raise_for_status()


def forwarded(centre: Server, **fields: Any) -> dict[str, Any]:
    """The robot's session at the centre, once some fields of its state are so."""
    (state,) = eventually(
        lambda: centre.get("sessions", origin="robot7")["items"],
        lambda found: [{key: one[key] for key in fields} for one in found] == [fields],
    )
    return {**state, "steps": state["counters"]["steps"], "violations": state["properties"][0]["violations"]}


async def test_what_a_robot_has_deleted_before_its_end_came_is_closed_at_the_centre(
    url: str, specs: Path, centre: Server, tmp_path: Path
) -> None:
    forwarding = {"ORACLE_FORWARD": url, "ORACLE_ORIGIN": "robot7"}
    with Server(specs, tmp_path / "robot", **forwarding) as robot:
        await drive(robot, 1, 11)
        eventually(lambda: forwarded(centre)["steps"], lambda steps: steps == 2)
    with Server(specs, tmp_path / "robot", ORACLE_RETAIN_AGE="1ms", **AT_ONCE) as robot:  # it does not forward
        await drive(robot, 11, first=3)
        close(robot, "s1")
        eventually(lambda: robot.get("sessions")["items"], lambda found: not found)
    assert forwarded(centre)["live"]
    with Server(specs, tmp_path / "robot", **forwarding):
        state = forwarded(centre, status="closed", closed_because="its robot has deleted it")
    assert (state["live"], state["steps"], state["violations"]) == (False, 2, 1)
    assert state["trouble"].startswith("'robot7' has deleted it without having forwarded its end")


async def test_a_session_of_a_robot_that_is_not_heard_can_be_closed_and_goes_on_where_it_is_heard_again(
    url: str, specs: Path, centre: Server, postgres: Postgres, tmp_path: Path
) -> None:
    with Server(specs, tmp_path / "robot", ORACLE_FORWARD=url, ORACLE_ORIGIN="robot7") as robot:
        await drive(robot, 1, 11)
        eventually(lambda: forwarded(centre)["steps"], lambda steps: steps == 2)
        refused = problem(centre.http.delete("/api/v1/sessions/s1@robot7"), 409)
        assert "only the server there can do this" in refused["detail"]
        postgres.do("UPDATE origins SET heard = '2026-01-02 03:04:59+00'", url)
        close(centre, "s1@robot7")
        state = forwarded(centre, status="closed", closed_because="by request")
        assert (state["steps"], state["violations"]) == (2, 1)
        assert "was heard last at 2026-01-02 03:04 UTC" in state["trouble"]
        await drive(robot, 1, 11, first=3)
        forwarded(centre, status="open", live=True, trouble=None)
        eventually(lambda: forwarded(centre)["violations"], lambda violations: violations == 2)
        close(robot, "s1")
        state = forwarded(centre, status="closed", closed_because="by request", trouble=None)
        assert (state["steps"], state["violations"]) == (4, 2)


async def test_one_that_its_robot_could_not_restore_says_so_at_the_centre_until_it_is_restored(
    url: str, specs: Path, centre: Server, tmp_path: Path
) -> None:
    forwarding = {"ORACLE_FORWARD": url, "ORACLE_ORIGIN": "robot7"}
    with Server(specs, tmp_path / "robot", **forwarding) as robot:
        await drive(robot, 1, 11)
    for nothing, unsound in (("not ", "nott "), ("nott ", "not ")):
        with closing(sqlite3.connect(tmp_path / "robot" / "history.sqlite")) as database:
            database.execute("UPDATE sessions SET text = replace(text, ?, ?)", (nothing, unsound))
            database.commit()
        with Server(specs, tmp_path / "robot", **forwarding) as robot:
            state = robot.get("sessions/s1")
            assert (state["trouble"] is None) == (unsound == "not ")
            forwarded(centre, status="open", live=state["status"] == "open", trouble=state["trouble"])


async def test_who_asks_for_a_session_that_another_disk_had_the_name_of_is_told_its_name_at_the_robot(
    url: str, specs: Path, centre: Server, tmp_path: Path
) -> None:
    for sessions, disk in enumerate(("old", "new"), 1):
        with Server(specs, tmp_path / disk, ORACLE_FORWARD=url, ORACLE_ORIGIN="robot7") as robot:
            await drive(robot, 1)
            eventually(lambda: len(centre.get("sessions", origin="robot7")["items"]), partial(eq, sessions))
    for name in ("s1", "s1.1"):
        refused = problem(centre.http.delete(f"/api/v1/sessions/{name}@robot7"), 409)
        assert refused["detail"].endswith("where it is 's1'")
        async with connected(centre) as monitor:
            await monitor.send(make_attach(session=f"{name}@robot7", spec="single"))
            ((error,), _) = await monitor.closed()
        assert error["message"].endswith("where it is 's1'")
