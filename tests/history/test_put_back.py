"""A database in PostgreSQL of which a part was put back, or that has got another schema."""

from __future__ import annotations

import asyncio

import pytest

from oracle_server.core.errors import HistoryError
from oracle_server.history.postgres.history import PostgresHistory
from oracle_server.history.postgres.store import Node
from tests.history.making import add, opened, step
from tests.history.test_postgres import begun
from tests.history.test_sharing import taken
from tests.postgres import Postgres


async def kept(url: str) -> None:
    """A database that a server leaves with an open session, and one that a robot forwards."""
    history = await begun(url)
    history.open_session(opened())
    await add(history, step(1))
    await asyncio.to_thread(history.close)


@pytest.mark.parametrize("lost", ["nodes", "owners", "format", "nodes, owners, format, origins, forwarded"])
async def test_open_sessions_that_no_server_has_are_taken_over(lost: str, postgres: Postgres) -> None:
    """They were said to be taken over soon by another server, and none ever did."""
    url = postgres.empty()
    await kept(url)
    postgres.do(f"DROP TABLE {lost}", url)
    if "owners" in lost:
        postgres.do("DROP SEQUENCE session_numbers", url)
        postgres.do("UPDATE sessions SET id = 's1@robot7', number = 7", url)
        postgres.do(
            "INSERT INTO sessions (number, id, spec, text, digest, properties, private, opened) "
            "SELECT 1, 's1', spec, text, digest, properties, private, opened FROM sessions",
            url,
        )
    history = await asyncio.to_thread(PostgresHistory, url, 0.5, lambda: None, Node("b"))
    history.start(asyncio.get_running_loop())
    assert await taken(history) == [1], "and not what is a robot's"
    await asyncio.to_thread(history.close)


@pytest.mark.parametrize("lost", ["steps", "forgotten"])
async def test_a_history_without_some_of_its_tables_is_refused(lost: str, postgres: Postgres) -> None:
    url = postgres.empty()
    await kept(url)
    postgres.do(f"DROP TABLE {lost}", url)
    with pytest.raises(HistoryError, match=f"of the history's tables these are missing: {lost}; put all"):
        PostgresHistory(url)


async def test_a_schema_that_is_made_later_hides_no_history(postgres: Postgres) -> None:
    """As one by the role's name, which is first in PostgreSQL's `search_path`: new tables were made there, empty."""
    schema, later = postgres.part(), postgres.part()
    await kept(postgres.url(schema))
    postgres.do("DROP TABLE forgotten; UPDATE format SET version = 11", postgres.url(schema))
    history = await begun(postgres.url(f"{later},{schema}"))
    assert [session.id for session in await history.open_sessions()] == [opened().id]
    await add(history, step(2))
    await asyncio.to_thread(history.close)
    assert postgres.do(f"SELECT count(*) FROM pg_tables WHERE schemaname = '{later}'") == [(0,)]
