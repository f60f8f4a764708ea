"""The task that prunes goes on, whatever happens to it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from oracle_server.core.errors import HistoryError
from oracle_server.core.spec import Retention
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.retention import Pruner
from tests.history.making import add, opened, step
from tests.processes import PATIENCE


class Failing(MemoryHistory):
    """A history of which one query fails once."""

    def __init__(self, error: Exception) -> None:
        super().__init__()
        self.error: Exception | None = error

    async def size(self) -> int:
        error, self.error = self.error, None
        if error is not None:
            raise error
        return await super().size()


async def until(good: Callable[[], Awaitable[object]]) -> None:
    async with asyncio.timeout(PATIENCE):
        while not await good():
            await asyncio.sleep(0)


@pytest.mark.parametrize("error", [HistoryError("the history can't be read: disk I/O error"), ValueError("a bug")])
async def test_what_fails_once_is_tried_again(error: Exception, capsys: pytest.CaptureFixture[str]) -> None:
    history = Failing(error)
    history.start(asyncio.get_running_loop())
    history.open_session(opened())
    await add(history, *(step(i) for i in range(1, 6)))
    history.close_session(1, 1, {})
    await history.flush()
    pruner = Pruner(history, Retention(events=2), dict, lambda age: -age, lambda _: None)
    pruning = asyncio.create_task(pruner.run(0.001))

    async def pruned() -> bool:
        return await history.extent(1) == (4, 5)

    await until(pruned)
    assert history.error is None
    assert str(error) in capsys.readouterr().out
    assert not pruning.done()
    pruning.cancel()
