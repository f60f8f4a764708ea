"""A session of which the history's row can't be read, as where a disk has failed."""

from __future__ import annotations

import sqlite3
from contextlib import closing

import pytest

from tests.whole.client import attached, connected, make_attach, make_event
from tests.whole.conftest import Starts

WHY = "the history is damaged: session number 1 can't be read"


@pytest.mark.parametrize("change", ["properties = '[1]'", "opened = 'soon'", "text = x'ff'"])
async def test_it_is_left_alone_and_told_of_and_others_go_on(start: Starts, change: str) -> None:
    server = start()
    for name in ("lost", "kept"):
        async with attached(server, session=name, spec="single") as monitor:
            await monitor.send(make_event(1, at=1, data={"v": 11}))
            await monitor.acked(1)
    assert server.stop() == 0
    with closing(sqlite3.connect(server.data / "history.sqlite")) as database, database:
        assert database.execute(f"UPDATE sessions SET {change} WHERE id = 'lost'").rowcount == 1
    server = start()
    assert [state["id"] for state in server.get("sessions")["items"]] == ["kept"]
    assert WHY in server.log
    async with attached(server, session="kept") as monitor:
        await monitor.send(make_event(2, at=2, data={"v": 11}))
        await monitor.acked(2)
    async with connected(server) as monitor:
        await monitor.send(make_attach(session="lost", spec="single"))
        refused = await monitor.recv()
    assert refused["type"] == "error"
    assert WHY in refused["message"]
