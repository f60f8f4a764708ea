"""Several servers over one PostgreSQL: who has which session, and who gets it where a server is gone."""

from __future__ import annotations

import asyncio
import itertools
import threading
from collections.abc import AsyncIterator, Awaitable, Callable

import psycopg
import pytest
import pytest_asyncio

from oracle_server.history.postgres import history as history_module
from oracle_server.history.postgres.history import PostgresHistory
from oracle_server.history.postgres.store import Node
from oracle_server.history.records import Elsewhere
from tests.history.making import add, opened, step
from tests.history.test_port import collected
from tests.postgres import Postgres
from tests.processes import PATIENCE

LEASE = 0.5
Begin = Callable[..., Awaitable[PostgresHistory]]


@pytest_asyncio.fixture
async def begin(postgres: Postgres) -> AsyncIterator[Begin]:
    """Servers by their names over one database; those that are not `hung` go on."""
    url, begun = postgres.empty(), list[PostgresHistory]()

    async def begin(name: str, *, hung: bool = False, end: Callable[[], object] = lambda: None) -> PostgresHistory:
        node = Node(name, f"http://{name}:8642")
        history = await asyncio.to_thread(PostgresHistory, url, LEASE, end, node)
        begun.append(history)
        if not hung:
            history.start(asyncio.get_running_loop())
        return history

    yield begin
    for history in begun:
        await asyncio.to_thread(history.close)


async def taken(history: PostgresHistory, *known: int) -> list[int]:
    """The sessions that a server gets, once it gets some."""
    async with asyncio.timeout(PATIENCE):
        while not (got := await history.take_over(known)):
            await asyncio.sleep(0.01)
    return [session.number for session in got]


async def test_each_session_is_one_servers_and_all_read_it(begin: Begin) -> None:
    a, b = await begin("a"), await begin("b")
    for history, name in ((a, "s1"), (b, "s2")):
        number = await history.reserve(name, 1)
        assert number is not None
        history.open_session(opened(number, name))
        await add(history, step(1), session=number)
    first, second = await a.open_sessions(), await b.open_sessions()
    assert ([s.id for s in first], [s.id for s in second]) == (["s1"], ["s2"])
    assert first[0].number != second[0].number
    assert await b.elsewhere("s1") == Elsewhere("a", "http://a:8642", here=False, lasting=True)
    assert await a.elsewhere("s1") == Elsewhere("a", "http://a:8642", here=True, lasting=True)
    assert await collected(b.steps(first[0].number, 0)) == [step(1)]
    (other,) = await b.open_elsewhere()
    assert (other.record.id, other.place.node, other.steps) == ("s1", "a", 1)
    await add(a, step(2, kind="tick"), session=first[0].number)
    assert [other.steps for other in await b.open_elsewhere()] == [1], "a deadline is no step"
    assert await b.take_over([second[0].number]) == []
    assert b.others
    a.close_session(first[0].number, 5, {})
    await a.flush()
    assert await b.elsewhere("s1") is None
    assert await b.open_elsewhere() == []
    assert await b.reserve("s1", 1) is None, "the name stays its own"


async def test_many_servers_never_give_one_number_or_name_twice(begin: Begin) -> None:
    servers = [await begin(name) for name in "abc"]
    names = [f"s{i}" for i in range(10)]
    pairs = [*itertools.product(servers, names)]
    given = await asyncio.gather(*(history.reserve(name, 1) for history, name in pairs))
    numbers = [number for number in given if number is not None]
    assert len(numbers) == len({*numbers}) == len(names)
    assert len({name for (_, name), number in zip(pairs, given, strict=True) if number is not None}) == len(names)


async def test_a_number_that_somebody_took_by_himself_is_not_given(begin: Begin, postgres: Postgres) -> None:
    a = await begin("a")
    a.open_session(opened(1, "s1"))
    await a.flush()
    assert await a.reserve("s2", 1) == 2
    assert await a.reserve("s1", 1) is None


async def test_sessions_of_a_server_that_stands_still_are_one_others(begin: Begin) -> None:
    """It has begun a transaction, and holds its rows locked; it is ended, and what it writes then is refused."""
    ended = threading.Event()
    a = await begin("a", hung=True, end=ended.set)
    a.open_session(opened(1, "s1"))  # its writer begins later
    connection = a.store._database
    assert connection is not None
    a.store.transact(lambda _: None)
    b, c = await begin("b"), await begin("c")
    with psycopg.connect(a.store._url, autocommit=True) as raw:
        raw.execute("INSERT INTO owners (session, id, node) SELECT n, 's' || n, 'a' FROM generate_series(2, 21) AS n")
        raw.execute(
            "INSERT INTO sessions (number, id, spec, text, digest, properties, private, opened) "
            "SELECT n, 's' || n, 'spec', '', '', '[]', 0, 0 FROM generate_series(2, 21) AS n"
        )
    connection.execute("BEGIN")
    connection.execute("UPDATE nodes SET batch = batch WHERE node = 'a'")
    got: list[list[int]] = [[], []]

    async def take(i: int, history: PostgresHistory) -> None:
        async with asyncio.timeout(PATIENCE):
            while len(got[0]) + len(got[1]) < 20:
                got[i] += [s.number for s in await history.take_over(got[i])]
                await asyncio.sleep(0.01)

    await asyncio.gather(take(0, b), take(1, c))
    assert sorted(got[0] + got[1]) == [*range(2, 22)]
    a.start(asyncio.get_running_loop())
    assert await asyncio.to_thread(ended.wait, PATIENCE)
    assert a.fenced
    assert a.adrift
    assert await b.session("s1") is None, "what it had not committed is not there"


async def test_a_server_begins_beside_one_that_stands_still_while_it_writes(begin: Begin) -> None:
    """It has its row locked, and nobody else is there who would end it."""
    a = await begin("a", hung=True)
    connection = a.store._database
    assert connection is not None
    connection.execute("INSERT INTO owners (session, id, node) VALUES (1, 's1', 'a')")
    connection.execute(
        "INSERT INTO sessions (number, id, spec, text, digest, properties, private, opened) "
        "VALUES (1, 's1', 'spec', '', '', '[]', 0, 0)"
    )
    connection.execute("BEGIN")
    connection.execute("UPDATE nodes SET batch = batch WHERE node = 'a'")
    b = await begin("b")
    assert await taken(b) == [1]


async def test_nobody_takes_over_where_postgresqls_clock_is_set_forward(begin: Begin, postgres: Postgres) -> None:
    """By that clock all leases have run out: servers took each other's sessions, and all but one ended."""
    a, b = await begin("a"), await begin("b")
    a.open_session(opened(1, "s1"))
    await a.flush()
    url, end = a.store._url, asyncio.get_running_loop().time() + 4 * LEASE
    while asyncio.get_running_loop().time() < end:
        postgres.do("UPDATE nodes SET until = until - interval '1 hour' WHERE until > now()", url)
        assert await b.take_over([]) == []
    await add(a, step(1))
    await asyncio.to_thread(a.close)
    assert await taken(b) == [1]


async def test_sessions_of_a_lease_of_before_postgresqls_clock_was_set_back_are_taken_over(
    begin: Begin, postgres: Postgres, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By that clock the lease would be one for as long as it was set back; that of who renews it is no such lease."""
    monkeypatch.setattr(history_module, "LONGEST_LEASE", 1.0)
    a, b, c = await begin("a"), await begin("b"), await begin("c")
    a.open_session(opened(1, "s1"))
    c.open_session(opened(2, "s2"))
    await a.flush()
    await c.flush()
    url = a.store._url
    await asyncio.to_thread(a.close)
    postgres.do("UPDATE nodes SET until = clock_timestamp() + interval '1 hour' WHERE node = 'a'", url)
    assert await taken(b) == [1]
    assert [session.id for session in await c.open_sessions()] == ["s2"]
    assert await b.tended() == frozenset({1}), "and what is closed is deleted by a server that is there"


async def test_a_server_that_stops_gives_its_sessions_at_once_and_begins_without_them(begin: Begin) -> None:
    a, b = await begin("a"), await begin("b")
    a.open_session(opened(1, "s1"))
    await add(a, step(1))
    await asyncio.to_thread(a.close)
    assert await taken(b) == [1]
    again = await begin("a")
    assert await again.open_sessions() == []
    assert await again.take_over([]) == []
    await add(b, step(2))
    assert await collected(again.steps(1, 0)) == [step(1), step(2)]


async def test_a_server_that_is_back_before_others_look_has_its_sessions(begin: Begin) -> None:
    a, b = await begin("a"), await begin("b")
    a.open_session(opened(1, "s1"))
    await a.flush()
    await asyncio.to_thread(a.close)
    again = await begin("a")
    assert [session.id for session in await again.open_sessions()] == ["s1"]
    assert await b.take_over([]) == []


async def test_what_is_closed_is_deleted_by_one_server_and_what_is_open_by_its_own(begin: Begin) -> None:
    a, b = await begin("a"), await begin("b")
    for history, number in ((a, 1), (b, 2), (b, 3)):
        history.open_session(opened(number, f"s{number}"))
    b.close_session(3, 5, {})
    await a.flush()
    await b.flush()
    assert await a.tended() == frozenset({1, 3})
    assert await b.tended() == frozenset({2})


async def test_sessions_from_before_there_were_several_servers_are_taken_over(begin: Begin, postgres: Postgres) -> None:
    a = await begin("server")
    a.open_session(opened(7, "s7"))
    await a.flush()
    url = a.store._url
    await asyncio.to_thread(a.close)
    postgres.do("DROP TABLE owners; DROP SEQUENCE session_numbers; ALTER TABLE nodes DROP COLUMN url", url)
    b = await begin("b")
    assert await taken(b) == [7]
    assert await b.reserve("new", 1) == 8


async def test_nobody_has_a_closed_session_whose_row_a_killed_server_left(begin: Begin, postgres: Postgres) -> None:
    a = await begin("a")
    a.open_session(opened(1, "s1"))
    a.close_session(1, 5, {})
    await a.flush()
    postgres.do("INSERT INTO owners (session, id, node) VALUES (1, 's1', 'a')", a.store._url)
    assert await a.elsewhere("s1") is None
