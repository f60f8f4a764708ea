"""One process that answers questions, for all histories of a test process: each takes half a second to start."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from oracle_server.history.sql import answering, asking
from oracle_server.process.worker import Worker


class _Shared(Worker):
    """Takes questions of any history, one at a time, and goes on when one of them is closed."""

    def __init__(self) -> None:
        super().__init__(answering.__name__)
        self._turns = threading.Lock()

    def ask(self, request: object, within: float) -> bytes:
        with self._turns:
            return super().ask(request, within)

    def close(self) -> None:
        """Nothing: the others go on asking."""


@contextmanager
def shared_reader() -> Iterator[None]:
    """Have histories that are made meanwhile ask one process."""
    shared = _Shared()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(asking, "Worker", lambda _: shared)
        yield
    shared.end()
