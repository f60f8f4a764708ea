"""What retention deletes while a session is read as a whole is told: without it, a download would look complete."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Callable

import pytest

from oracle_server.core.errors import HistoryError
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.pages import unbroken
from oracle_server.history.port import History
from oracle_server.history.records import StoredStep
from tests.history.making import opened, step

COUNT = 400
Read = Callable[[History, int], AsyncGenerator[list[StoredStep], None]]
READS = [lambda history, session: history.by_arrival(session), unbroken]


async def read(history: History, reading: Read, upto: int | None) -> list[int]:
    """The positions that are read where some, or with None all of the session, go behind the first page."""
    history.open_session(opened())
    history.append(1, [step(i) for i in range(1, COUNT + 1)], lambda: None)
    await history.flush()
    pages = reading(history, 1)
    found = await anext(pages)
    assert len(found) < COUNT or isinstance(history, MemoryHistory)
    await history.forget_steps(1, COUNT + 1 if upto is None else upto)
    if upto is None:
        await history.forget_session(1)
    async for page in pages:
        found += page
    return [each.position for each in found]


@pytest.mark.parametrize("upto", [200, COUNT, None])
@pytest.mark.parametrize("reading", READS, ids=["by_arrival", "unbroken"])
async def test_steps_that_go_before_they_are_read_are_missed_by_nobody_unseen(
    history: History, reading: Read, upto: int | None
) -> None:
    """The downloads ended as whole ones do, with the steps in the middle, or all that were left, missing."""
    if isinstance(history, MemoryHistory):  # it reads what was there at first
        assert await read(history, reading, upto) == [*range(1, COUNT + 1)]
        return
    with pytest.raises(HistoryError, match="was deleted before it was read"):
        await read(history, reading, upto)


@pytest.mark.parametrize("reading", READS, ids=["by_arrival", "unbroken"])
async def test_steps_that_go_once_they_are_read_are_not_missed(history: History, reading: Read) -> None:
    assert await read(history, reading, 50) == [*range(1, COUNT + 1)]
