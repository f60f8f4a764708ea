"""Rows of half a megabyte: pages of them are short, and have all of them once."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import msgspec
import pytest

from oracle_server.core.formula.tree import Scalar
from oracle_server.history.matching import MOST_BYTES
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.port import History
from oracle_server.history.query import Query
from oracle_server.history.records import StoredStep
from oracle_server.history.sql import reader
from tests.history.making import PROPERTIES, add, find, opened, step

LONG = 2**19
COUNT = 24


def long_step(position: int, size: int = LONG, *, told: bool = False) -> StoredStep:
    """A step with a long signal, and where it is told with violations whose explanations have it."""
    made = step(position, arrived=10_000 - position, violated=(0, 1) if told else ())
    signals: dict[str, Scalar] = {"v": position, "s": "x" * size}
    for why in made.explanations.values():
        why["event"]["signals"] = signals
    return msgspec.structs.replace(made, step=msgspec.structs.replace(made.step, signals=signals))


@pytest.mark.parametrize("order", ["asc", "desc"])
async def test_a_page_of_long_records_ends_early_and_all_pages_have_each_once(
    history: History, order: Literal["asc", "desc"]
) -> None:
    history.open_session(opened())
    await add(history, *(long_step(n, told=True) for n in range(1, COUNT + 1)))
    query, numbers, pages = Query(limit=1_000, order=order), list[int](), 0
    after: int | None = None
    while pages == 0 or after is not None:
        found, after = await find(history, opened(), replace(query, after=after))
        numbers += [record["n"] for record in found]
        pages += 1
        assert (len(found) - 1) * LONG < MOST_BYTES, "no more behind the one that fills it"
    every = range(1, COUNT * len(PROPERTIES) + 1)
    assert numbers == sorted(every, reverse=order == "desc")
    assert pages > 5


async def test_pages_of_long_rows_are_short_and_have_each_once(history: History) -> None:
    history.open_session(opened())
    made = [long_step(n, LONG if 80 < n <= 104 else 1) for n in range(1, 121)]
    await add(history, *made)
    in_memory = isinstance(history, MemoryHistory)  # which has them all there already
    for pages, wanted in ((history.steps(1, 0), made), (history.by_arrival(1), made[::-1])):
        found = list[StoredStep]()
        async for page in pages:
            found += page
            assert in_memory or sum(len(str(row.step.signals["s"])) for row in page[:-1]) < reader.MOST_BYTES
        assert found == wanted
