"""What is kept of the history, and what may go."""

from __future__ import annotations

import sqlite3
from contextlib import closing

from tests.server.client import attached, make_event, make_events
from tests.server.conftest import Starts
from tests.server.harness import Server

OFTEN = {"ORACLE_RETAIN_CHECK": "0.05"}


async def fill(server: Server, session: str, count: int, *, closed: bool = True, spec: str = "single") -> None:
    async with attached(server, session=session, spec=spec) as monitor:
        await monitor.send(make_events(*(make_event(i, at=i, data={"v": 20 * (i % 2)}) for i in range(1, count + 1))))
        await monitor.acked(count)
    if closed:
        assert server.http.delete(f"/api/v1/sessions/{session}").status_code == 200


def kept(server: Server) -> dict[str, list[int]]:
    """The `n` of what is kept, by session."""
    found = {}
    for session in server.get("sessions")["items"]:
        response = server.http.get(f"/api/v1/sessions/{session['id']}/verdicts", params={"limit": 1000})
        if response.status_code != 404:  # it may have gone since it was listed
            found[session["id"]] = [r["n"] for r in response.json()["items"]]
    return found


async def test_the_oldest_events_of_closed_sessions_go_first(start: Starts) -> None:
    server = start()
    for name in ("one", "two", "three"):
        await fill(server, name, 30)
    await fill(server, "open", 30, closed=False)
    assert server.stop() == 0
    server = start(**OFTEN, ORACLE_RETAIN_EVENTS="75")
    wanted = {"open": list(range(1, 31)), "three": list(range(1, 31)), "two": list(range(16, 31))}
    await server.until(lambda: kept(server), lambda found: found == wanted)
    (violation,) = server.records("two", "violations", limit=1, after=20)[:1]
    assert violation["n"] == 21
    assert server.get("sessions/two")["counters"]["steps"] == 30
    assert server.http.get("/api/v1/sessions/one").status_code == 404
    await fill(server, "one", 3)


async def test_an_open_session_keeps_what_it_is_restored_from(start: Starts) -> None:
    server = start(**OFTEN, ORACLE_RETAIN_EVENTS="1", ORACLE_RETAIN_AGE="1ms", ORACLE_RETAIN_SIZE="1kB")
    await fill(server, "open", 40, closed=False)
    await fill(server, "closed", 5)
    await server.until(lambda: kept(server).keys(), lambda names: "closed" not in names)
    state = server.get("sessions/open")["properties"]
    assert server.stop() == 0
    server = start()
    assert kept(server) == {"open": list(range(1, 41))}
    assert server.get("sessions/open")["properties"] == state


async def test_nothing_is_left_of_a_session_that_goes(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="single") as monitor:
        await monitor.send(make_event(1, "/nowhere"))
        await monitor.expect("error", seq=1)
        await monitor.send(make_events(*(make_event(i, at=i, data={"v": 1}) for i in range(2, 1501))))
        await monitor.acked(1500)
    assert server.http.delete("/api/v1/sessions/s").status_code == 200
    assert server.stop() == 0
    with closing(sqlite3.connect(server.data / "history.sqlite")) as database:
        tables = [name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        database.execute("INSERT OR IGNORE INTO snapshots VALUES (1, 1, '{}')")
        database.commit()
        assert all(database.execute(f"SELECT count(*) FROM {name}").fetchone()[0] for name in tables), tables
        server = start(**OFTEN, ORACLE_RETAIN_AGE="1ms")
        await server.until(lambda: kept(server), lambda found: not found)
        assert not any(database.execute(f"SELECT count(*) FROM {name}").fetchone()[0] for name in tables), tables


async def test_a_session_goes_once_it_was_closed_long_enough(start: Starts) -> None:
    server = start()
    await fill(server, "s", 5)
    assert server.stop() == 0
    server = start(**OFTEN, ORACLE_RETAIN_AGE="1h")
    await fill(server, "t", 5)
    assert kept(server).keys() == {"s", "t"}
    assert server.stop() == 0
    server = start(**OFTEN, ORACLE_RETAIN_AGE="1ms")
    await server.until(lambda: kept(server), lambda found: not found)


async def test_a_history_that_is_too_large_makes_room(start: Starts) -> None:
    server = start()
    for name in ("one", "two"):
        await fill(server, name, 2000)
    assert server.stop() == 0
    server = start(**OFTEN, ORACLE_RETAIN_SIZE="300kB")
    found = await server.until(lambda: kept(server), lambda found: "one" not in found and found["two"][0] > 1)
    assert found["two"][0] < 2000
    assert server.get("sessions/two")["counters"]["steps"] == 2000
    assert server.records("two", order="desc", limit=1)[0]["n"] == 2000


async def test_a_spec_has_bounds_of_its_own(start: Starts) -> None:
    server = start(**OFTEN)
    path = server.specs / "single.yaml"
    other = path.read_text().replace("id: single", "id: unbounded")
    assert server.http.put("/api/v1/specs/unbounded", content=other).status_code == 201
    path.write_text(path.read_text() + "retention: {events: 10}\n")
    digest = server.get("specs/single")["digest"]
    path.write_text(path.read_text().replace("events: 10", "events: 12, age: 100h, size: 5GB"))
    assert server.get("specs/single")["digest"] == digest
    await fill(server, "bounded", 30)
    await fill(server, "free", 30, spec="unbounded")
    found = await server.until(lambda: kept(server), lambda found: len(found["bounded"]) < 30)
    assert found["bounded"] == list(range(19, 31))
    assert found["free"] == list(range(1, 31))
