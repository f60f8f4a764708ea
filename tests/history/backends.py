"""Empty histories of every backend."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from oracle_server.history.memory import MemoryHistory
from oracle_server.history.port import History
from oracle_server.history.postgres.history import PostgresHistory
from oracle_server.history.sqlite.history import SqliteHistory
from tests.postgres import Postgres, Relay

BACKENDS = ("memory", "postgres", "sqlite")
Make = Callable[[str], History]
"""Makes an empty history of a backend."""


@pytest.fixture(scope="session")
def postgres() -> Iterator[Postgres]:
    """A PostgreSQL that runs while tests need it."""
    with Postgres() as made:
        yield made


@pytest.fixture
def relay(postgres: Postgres) -> Iterator[Relay]:
    """What lies between a server and PostgreSQL."""
    made = Relay(postgres)
    yield made
    made.close()


@pytest.fixture
def make(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Make:
    """Makes empty histories, by the names of backends."""

    def make(backend: str) -> History:
        if backend == "memory":
            return MemoryHistory()
        if backend == "sqlite":
            return SqliteHistory(tmp_path_factory.mktemp("history"))
        return PostgresHistory(request.getfixturevalue("postgres").empty())

    return make
