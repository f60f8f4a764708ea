"""What a database or a role has set for its connections changes nothing of a history in it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing

import pytest

from oracle_server.history.copying import run
from oracle_server.history.postgres.connection import Connection
from oracle_server.history.postgres.history import PostgresHistory
from tests.postgres import Postgres


@pytest.fixture
def otherwise(postgres: Postgres) -> Iterator[Postgres]:
    with postgres.having("datestyle", "German, DMY"), postgres.having("default_transaction_isolation", "serializable"):
        yield postgres


def test_a_centre_is_copied_whose_times_are_written_in_the_way_of_a_country(otherwise: Postgres) -> None:
    source, target, heard = otherwise.empty(), otherwise.empty(), "SELECT origin, heard FROM origins"
    PostgresHistory(source).close()
    otherwise.do("INSERT INTO origins (origin, robot, writer, seq) VALUES ('robot7', 'r', 'w', 1)", source)
    run.copy_history(source, target)
    with closing(Connection(source, "test", 10.0)) as here, closing(Connection(target, "test", 10.0)) as there:
        assert here.execute(heard).fetchall() == there.execute(heard).fetchall() != []


def test_a_transaction_sees_what_was_committed_before_each_of_its_statements(otherwise: Postgres) -> None:
    """As servers need it that wait for each other's locks, and then look at what the other one has made."""
    url = otherwise.empty()
    with closing(Connection(url, "one", 10.0)) as one, closing(Connection(url, "other", 10.0)) as other:
        one.execute("CREATE TABLE numbers (n BIGINT)")
        one.execute("BEGIN")
        assert one.execute("SELECT count(*) FROM numbers").fetchone() == (0,)
        other.execute("INSERT INTO numbers VALUES (1)")
        assert one.execute("UPDATE numbers SET n = 2 RETURNING n").fetchall() == [(2,)]
        one.commit()
