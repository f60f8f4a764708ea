"""How many rows a second `history copy` brings to PostgreSQL, and back.

python benchmarks/copying.py [--url postgresql://USER@HOST/EMPTY_DATABASE] [--rows 200000] [--folder /tmp]

Without `--url` a PostgreSQL of Debian's packages is started for it. The rows are those of `timeline.py`. Beside each
rate stands its ratio to that of reading the same rows alone, in the same run.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import psycopg
from database import database
from timeline import filled

from oracle_server.history.copying.ends import End
from oracle_server.history.copying.inpostgres import PostgresEnd
from oracle_server.history.copying.insqlite import SqliteEnd
from oracle_server.history.copying.run import copy
from oracle_server.history.copying.tables import tables


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--url")
    parser.add_argument("--rows", type=int, default=200_000)
    parser.add_argument("--folder")
    asked = parser.parse_args()
    with database(asked.url) as url, tempfile.TemporaryDirectory(dir=asked.folder) as name:
        folder = Path(name)
        filled(folder, asked.rows)
        alone = rate("read alone", asked.rows, lambda: read(SqliteEnd(name, source=True)))
        there = lambda: copied(SqliteEnd(name, source=True), PostgresEnd(url))  # noqa: E731
        back = lambda: copied(PostgresEnd(url), SqliteEnd(f"{name}/back", source=False))  # noqa: E731
        rate("SQLite to PostgreSQL", asked.rows, there, alone)
        tell_size(url, asked.rows)
        rate("PostgreSQL to SQLite", asked.rows, back, alone)


def tell_size(url: str, count: int) -> None:
    """Print what a row takes on PostgreSQL's disk, with its index."""
    with psycopg.connect(url) as connection:
        found = connection.execute("SELECT pg_total_relation_size('steps')").fetchone()
    assert found
    print(f"in PostgreSQL: {found[0] / count:,.0f} bytes a row")


def rate(what: str, count: int, work: Callable[[], object], alone: float | None = None) -> float:
    """Print how many rows a second some work takes."""
    begun = time.perf_counter()
    work()
    found = count / (time.perf_counter() - begun)
    print(f"{what}: {found:,.0f} rows/s" + ("" if alone is None else f", {found / alone:.2f} of reading alone"))
    return found


def read(end: End) -> None:
    with closing(end):
        for table in tables():
            for _ in end.read(*table.reading(None)):
                pass


def copied(source: End, target: End) -> None:
    with closing(source), closing(target):
        copy(source, target, lambda *_, **__: None)


if __name__ == "__main__":
    main()
