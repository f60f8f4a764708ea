"""Downloads of a session: what can't be read is an error, and no answer that breaks off."""

from __future__ import annotations

from collections.abc import AsyncGenerator

import pytest

from oracle_server.core.errors import HistoryError
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.records import StoredStep
from tests.api.conftest import Asked
from tests.sessions.making import Kept, attach, event


@pytest.mark.parametrize(("what", "read"), [("trace", "by_arrival"), ("changes", "steps")])
async def test_a_history_that_cannot_be_read_is_told(
    asked: Asked, monkeypatch: pytest.MonkeyPatch, what: str, read: str
) -> None:
    """It was answered by 200 and an empty body, as a session without a step is."""

    async def unread(*pages: list[StoredStep]) -> AsyncGenerator[list[StoredStep], None]:
        for page in pages[:0]:
            yield page
        raise HistoryError("the disk fails")

    await asked.registry.create("single", "s")
    await asked.registry.flush()
    assert (await asked.http.get(f"/api/v1/sessions/s/{what}")).status_code == 200
    monkeypatch.setattr(MemoryHistory, read, unread)
    answer = await asked.http.get(f"/api/v1/sessions/s/{what}")
    assert (answer.status_code, answer.json()["detail"]) == (503, "the disk fails")


@pytest.mark.parametrize("what", ["trace", "changes"])
async def test_all_pages_are_sent_once(asked: Asked, what: str) -> None:
    live, monitor = await asked.registry.attach(attach("s", "single"), Kept())
    for i in range(1, 2502):
        live.ingest(monitor, event(i, "/a", id=1, v=20 * (i % 2)))
    live.ledger.write()
    await asked.registry.flush()
    lines = (await asked.http.get(f"/api/v1/sessions/s/{what}")).text.splitlines()
    assert len(lines) == len({*lines}) == 2501
