"""A pooler between a server and PostgreSQL, which is known by the numbers that it gives connections."""

from __future__ import annotations

from contextlib import closing
from types import SimpleNamespace
from typing import Any

from structlog.testing import capture_logs

from oracle_server.history.postgres.connection import Connection
from oracle_server.history.postgres.schema import check
from tests.postgres import Postgres


def warned(connection: Any) -> bool:
    with capture_logs() as logs:
        check(connection)
    return any("is a pooler" in line["event"] for line in logs)


def test_a_pooler_is_warned_of(postgres: Postgres) -> None:
    """One that gives a connection to several clients in turn had what was committed fail now and then."""
    with closing(Connection(postgres.empty(), "test", 10)) as connection:
        number = connection.raw.info.backend_pid + 1
        info = SimpleNamespace(backend_pid=number)
        assert warned(SimpleNamespace(execute=connection.execute, raw=SimpleNamespace(info=info)))
        assert not warned(connection)
