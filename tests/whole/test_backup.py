"""A copy of the history that was made while the server ran, and what is told where it is put back."""

from __future__ import annotations

import sqlite3
from contextlib import closing

from tests.whole.client import attached, make_event
from tests.whole.conftest import Starts

BIG = {"v": 11}


async def test_a_copy_put_back_has_what_was_acked_before_it_and_what_came_since_is_told_as_lost(start: Starts) -> None:
    server = start()
    copy = server.data.parent / "copy.sqlite"
    async with attached(server, session="s", spec="single") as monitor:
        await monitor.send(make_event(1, at=1, data=BIG))
        await monitor.acked(1)
        with closing(sqlite3.connect(f"file:{server.data}/history.sqlite?mode=ro", uri=True)) as database:
            database.execute("VACUUM INTO ?", (str(copy),))
        await monitor.send(make_event(2, at=2, data=BIG), make_event(3, at=3, data=BIG))
        await monitor.acked(3)
    assert server.stop() == 0
    for path in server.data.glob("history.sqlite*"):
        path.unlink()
    copy.rename(server.data / "history.sqlite")
    server = start()
    async with attached(server, session="s", spec="single") as monitor:
        assert monitor.attached["next"] == 2
        await monitor.send(make_event(4, at=4, data=BIG))
        await monitor.acked(4)
    assert [(r["seq"], r["degraded"]) for r in server.records("s")] == [(1, False), (4, True)]
    assert server.get("sessions/s")["doubts"] == ["2 events were lost, and not judged: /a"]


async def test_the_file_alone_of_a_history_in_use_is_told_to_be_none(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="single") as monitor:
        await monitor.send(make_event(1, at=1, data=BIG))
        await monitor.acked(1)
        alone = (server.data / "history.sqlite").read_bytes()
    assert "the history was empty" not in server.log
    assert server.stop() == 0
    (server.data / "history.sqlite").write_bytes(alone)
    server = start()
    assert server.get("sessions")["items"] == []
    assert "the history was empty; a copy of one in use lacks what is in the `history.sqlite-wal`" in server.log
