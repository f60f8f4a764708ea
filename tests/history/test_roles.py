"""Whose the tables of a database are that several roles use."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from oracle_server.core.errors import HistoryError
from oracle_server.history.postgres.history import PostgresHistory
from tests.postgres import Postgres


@pytest.fixture
def centre(postgres: Postgres) -> Iterator[Callable[[str], str]]:
    """How an empty database of the role `centre` is reached, by a role; `robot7` and `robot8` are its members."""
    for statement in (
        "CREATE ROLE centre LOGIN",
        "CREATE ROLE robot7 LOGIN IN ROLE centre",
        "CREATE ROLE robot8 LOGIN IN ROLE centre",
        "CREATE ROLE stranger LOGIN",
        "CREATE DATABASE centre OWNER centre",
    ):
        postgres.do(statement)
    yield lambda role: postgres.url().replace("tests@/postgres", f"{role}@/centre")
    postgres.do("DROP DATABASE centre")
    for role in ("robot7", "robot8", "stranger", "centre"):
        postgres.do(f"DROP ROLE {role}")


def test_what_a_robot_finds_empty_is_its_owners_and_all_members_may_use_it(centre: Callable[[str], str]) -> None:
    for role in ("robot7", "centre", "robot8"):
        PostgresHistory(centre(role)).close()


def test_who_is_no_member_makes_nothing_there(centre: Callable[[str], str]) -> None:
    with pytest.raises(HistoryError, match="permission denied for schema public"):
        PostgresHistory(centre("stranger"))
    PostgresHistory(centre("robot8")).close()
