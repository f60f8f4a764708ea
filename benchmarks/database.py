"""A PostgreSQL for the benchmarks: the one that is named, or one of Debian's packages, which ends with them."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path

USUAL = {"shared_buffers": "'128MB'", "autovacuum": "on"}
"""What PostgreSQL has unless somebody says otherwise, and the tests' own has not."""


@contextlib.contextmanager
def database(url: str | None) -> Iterator[str]:
    """The URL of an empty database, `url` where one is given."""
    if url is not None:
        yield url
        return
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    from tests.postgres import Postgres

    with Postgres(USUAL) as postgres:
        yield postgres.empty()
