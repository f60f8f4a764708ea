"""What is kept of the history, and what may go."""

from __future__ import annotations

import signal
import sqlite3
from contextlib import closing
from typing import Any

import pytest

from tests.whole.client import attached, make_event, make_events, stable
from tests.whole.conftest import Starts
from tests.whole.harness import Server, problem, run
from tests.whole.stories import play, tell
from tests.whole.test_stream import stream, take

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


async def test_lists_say_from_where_on_violations_are_kept(start: Starts) -> None:
    server = start()
    await fill(server, "s", 30)
    gone = "what was before verdict #21, and was violated, too, is not kept any more\n"
    lists = [f"sessions/s/{what}" for what in ("verdicts", "violations", "episodes")]
    assert [server.get(path)["kept_from"] for path in lists] == [1, 1, 1]
    for command in ("verdicts", "episodes"):
        assert "not kept" not in run(command, "s", "--url", server.url).stdout
    assert server.stop() == 0
    server = start(**OFTEN, ORACLE_RETAIN_EVENTS="10")
    await server.until(lambda: kept(server), lambda found: found == {"s": [*range(21, 31)]})
    assert [server.get(path)["kept_from"] for path in lists] == [21, 21, 21]
    assert server.get(lists[1], property="a_is_small", until=0) == {"items": [], "next": None, "kept_from": 21}
    for command in ("verdicts", "episodes"):
        assert gone in run(command, "s", "--url", server.url).stdout
    assert gone in run("episodes", "s", "--property", "a_is_small", "--url", server.url).stdout
    assert "not kept" not in run("episodes", "s", "--property", "other", "--url", server.url).stdout


@pytest.mark.parametrize("bound", [{"EVENTS": "1"}, {"AGE": "1ms"}, {"SIZE": "1kB"}], ids=str)
async def test_an_open_session_is_saved_and_keeps_what_came_since(start: Starts, bound: dict[str, str]) -> None:
    server = start(**OFTEN, **{f"ORACLE_RETAIN_{name}": value for name, value in bound.items()})
    await fill(server, "open", 40, closed=False)
    await fill(server, "closed", 5)
    await server.until(lambda: kept(server), lambda found: found == {"open": [40]})
    state = server.get("sessions/open")
    assert server.stop() == 0
    server = start()
    assert kept(server) == {"open": [40]}
    for name in ("properties", "counters"):
        assert server.get("sessions/open")[name] == state[name]
    async with attached(server, session="open") as monitor:
        assert monitor.attached["next"] == 41
        await monitor.send(*(make_event(i, at=i, data={"v": 1}) for i in (39, 40, 41)))
        await monitor.acked(41)
        await monitor.send(make_event(42, at=42, data={"v": 50}))
        await monitor.acked(42)
    assert kept(server) == {"open": [40, 41, 42]}
    explanation = "/api/v1/sessions/open/verdicts/{}/explanation"
    assert "not kept" in problem(server.http.get(explanation.format(40)), 409)["detail"]
    told = server.http.get(explanation.format(42)).json()
    assert (told["outcome"], told["explanation"]["event"]["seq"]) == ("currently_false", 42)


async def test_what_can_not_be_saved_is_kept_whole(start: Starts) -> None:
    server = start(**OFTEN, ORACLE_RETAIN_EVENTS="1")
    text = (server.specs / "single.yaml").read_text()
    for name, changed in {"by_reelay": text + "    engine: reelay\n", "twice": text + "ordering: {by: both}\n"}.items():
        content = changed.replace("id: single", f"id: {name}")
        assert server.http.put(f"/api/v1/specs/{name}", content=content).status_code == 201
        await fill(server, name, 10, closed=False, spec=name)
    await fill(server, "closed", 5)
    found = await server.until(lambda: kept(server), lambda found: "closed" not in found)
    assert (found["by_reelay"][0], found["twice"][0]) == (1, 1)


async def until_cut(server: Server, n: int) -> None:
    """Wait until nothing up to an `n` is kept of the session `s`."""
    await server.until(lambda: kept(server)["s"][0], lambda first: first > n)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
async def test_a_session_whose_beginning_is_gone_goes_on_as_if_nothing_had_happened(
    start: Starts, number: signal.Signals
) -> None:
    """One session is cut and its server ended again and again; the other is neither."""
    claimed, story = ["/a", "/b", "/go", "/free"], tell(7, chunks=4)
    whole = start()
    async with attached(whole, session="s", spec="pair", streams=claimed) as monitor:
        for chunk in story:
            await play(monitor, chunk)
    expected = stable(whole.records("s"))
    assert whole.stop() == 0
    (whole.data / "history.sqlite").unlink()
    found: dict[int, dict[str, Any]] = {}
    server, following = start(**OFTEN, ORACLE_RETAIN_EVENTS="3"), 1
    for chunk in story:
        async with attached(server, session="s", spec="pair", streams=claimed) as monitor:
            assert monitor.attached["next"] == following
            async with stream(server, "s", last=max(found, default=0)) as events:
                await play(monitor, chunk)
                last = server.get("sessions/s")["counters"]
                wanted = sum(r["seq"] <= chunk.last for r in expected) - len(found)
                found |= {r["n"]: r for r in await take(events, wanted)}
            following = chunk.last + 1
        await until_cut(server, max(found) - 3 * 6)
        server.process.send(number)
        server.process.wait()
        server.end()
        server = start(**OFTEN, ORACLE_RETAIN_EVENTS="3")
        assert server.get("sessions/s")["counters"] == last
    assert sorted(found) == [r["n"] for r in expected]
    unsaid = [{k: v for k, v in r.items() if k != "passed"} for r in stable([found[n] for n in sorted(found)])]
    assert unsaid == [{k: v for k, v in r.items() if k != "passed"} for r in expected]


async def test_a_session_whose_beginning_is_gone_and_snapshot_too_judges_no_more(start: Starts) -> None:
    server = start(**OFTEN, ORACLE_RETAIN_EVENTS="3")
    await fill(server, "s", 40, closed=False)
    await server.until(lambda: kept(server)["s"], lambda found: found == [38, 39, 40])
    assert server.stop() == 0
    with closing(sqlite3.connect(server.data / "history.sqlite")) as database:
        database.execute("UPDATE snapshots SET data = '{}'")
        database.commit()
    server = start()
    assert "can't be judged any more" in server.log
    async with attached(server, session="s") as monitor:
        assert monitor.attached["next"] == 41
        assert (await monitor.ask(41, at=41, data={"v": 1}))["verdicts"] == {"a_is_small": "unknown"}
        await monitor.acked(41)
    (state,) = server.get("sessions/s")["properties"]
    assert "its beginning is not kept any more" in state["broken"]
    assert [(r["n"], r["outcome"], r["degraded"]) for r in server.records("s", after=40)] == [(41, "unknown", True)]


async def test_many_refused_events_go_and_are_not_sent_or_lost_again(start: Starts) -> None:
    """Also where the snapshot that knew of them can't be used."""
    server = start(**OFTEN, ORACLE_RETAIN_EVENTS="1000")
    async with attached(server, session="s", spec="single") as monitor:
        await monitor.send(make_events(make_event(1, data={"v": 1}), make_event(2, data={"v": 10**25})))
        await monitor.send(make_events(*(make_event(seq, "/nowhere") for seq in range(3, 2502))))
        await monitor.acked(2501)
    with closing(sqlite3.connect(server.data / "history.sqlite")) as database:
        counted = "SELECT count(*), min(seq) FROM refused"
        await server.until(lambda: database.execute(counted).fetchone(), lambda found: found[0] < 2000)
        count, first = database.execute(counted).fetchone()
        assert count >= 1000
        assert first == 2502 - count, "the last ones stay"
        assert server.get("sessions/s")["counters"]["refused"] == 2500
        server.process.send(signal.SIGKILL)
        server.process.wait()
        server.end()
        database.execute("UPDATE snapshots SET data = '{}'")
        database.commit()
    server = start(**OFTEN, ORACLE_RETAIN_EVENTS="1000")
    async with attached(server, session="s", spec="single") as monitor:
        assert monitor.attached["next"] == 2502
        await monitor.send(make_event(2502, data={"v": 1}))
        await monitor.acked(2502)
    assert [(record["seq"], record["degraded"]) for record in server.records("s")] == [(1, False), (2502, True)]


async def test_nothing_is_left_of_a_session_that_goes(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="single") as monitor:
        await monitor.send(make_event(1, "/nowhere"))
        await monitor.expect("error", seq=1)
        await monitor.send(make_events(*(make_event(i, at=i, data={"v": 11 if i == 2 else 1}) for i in range(2, 1501))))
        await monitor.acked(1500)
    assert server.http.delete("/api/v1/sessions/s").status_code == 200
    assert server.stop() == 0
    with closing(sqlite3.connect(server.data / "history.sqlite")) as database:
        tables = [name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        database.execute("INSERT OR IGNORE INTO snapshots VALUES (1, 1, '{}', 0, NULL)")
        database.execute("INSERT INTO forgotten VALUES (1, 'small', 'publication', 1, 1, 1)")
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
    found = await server.until(lambda: kept(server), lambda found: len(found["bounded"]) <= 12)
    assert found["bounded"] == list(range(19, 31))
    assert found["free"] == list(range(1, 31))
