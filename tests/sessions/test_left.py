"""Sessions that robots have deleted are closed, one by one."""

from __future__ import annotations

import asyncio
from typing import Any, cast

import pytest

from oracle_server.core.errors import HistoryError, OracleError
from oracle_server.history.port import History
from oracle_server.sessions.registry import Registry
from oracle_server.sessions.sharing import close_left
from tests.processes import PATIENCE

LEFT = ["s1@robot7", "s2@robot7", "s3@robot8"]


class Centre:
    """A history that does not answer at first, and a registry by which one of the sessions can't be closed."""

    def __init__(self, error: Exception) -> None:
        self._error, self._answers = error, False
        self.closed = asyncio.Queue[str]()

    async def left(self) -> list[str]:
        if not self._answers:
            self._answers = True
            raise HistoryError("PostgreSQL: the connection is lost")
        return LEFT

    async def end(self, name: str, *_: Any) -> bool:
        if name == LEFT[0]:
            raise self._error
        self.closed.put_nowait(name)
        return True


@pytest.mark.parametrize("error", [OracleError("another server has it"), KeyError("properties")])
async def test_one_that_can_not_be_closed_keeps_no_other_open(error: Exception) -> None:
    centre = Centre(error)
    closing = asyncio.create_task(close_left(cast("Registry", centre), cast("History", centre), 0.0))
    async with asyncio.timeout(PATIENCE):
        assert [await centre.closed.get() for _ in LEFT[1:]] == LEFT[1:]
    assert not closing.done()
    closing.cancel()
