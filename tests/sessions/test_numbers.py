"""Numbers that another process of a monitor's name has given: what has them is no event that was received before."""

from __future__ import annotations

from pathlib import Path

import pytest

from oracle_server.history.memory import MemoryHistory
from oracle_server.wire.errors import WireError
from tests.sessions.making import GUARD, Kept, attach, event, registry


async def test_who_comes_back_after_another_is_not_told_what_was_decided_for_that_one(tmp_path: Path) -> None:
    """As an adapter that has asked while its link was lost, and sends that again."""
    sessions = registry(MemoryHistory(), tmp_path, GUARD)
    for instance, seq in (("one", 1), ("two", 2)):
        outbox = Kept()
        live, monitor = await sessions.attach(attach("s", "guard", instance=instance), outbox)
        assert monitor.numbering.next == seq
        live.ingest(monitor, event(seq, speed=0, ask=True))
        assert (await outbox.expect("decision"))[0]["decision"] == "allow"
        live.disconnected(monitor, outbox)
    outbox = Kept()
    live, monitor = await sessions.attach(attach("s", "guard", instance="one"), outbox)
    with pytest.raises(WireError, match="2 is the number of an event of another process: go on at `next`, 3") as told:
        live.ingest(monitor, event(2, speed=9, ask=True))
    assert (told.value.code, told.value.seq, told.value.fatal) == ("bad_seq", 2, False)
    live.ingest(monitor, event(3, speed=0, ask=True))
    live.ingest(monitor, event(3, speed=0, ask=True))
    assert [frame["seq"] for frame in await outbox.expect("decision", 2)] == [3, 3]


async def test_who_begins_at_one_again_is_told_and_its_session_is_not_called_sound(tmp_path: Path) -> None:
    sessions = registry(MemoryHistory(), tmp_path, GUARD)
    for instance in ("one", "two"):
        live, monitor = await sessions.attach(attach("s", "guard", instance=instance), Kept())
        if instance == "one":
            live.ingest(monitor, event(1, speed=0))
            live.disconnected(monitor, monitor.outbox)  # type: ignore[arg-type]
    with pytest.raises(WireError, match="go on at `next`, 2"):
        live.ingest(monitor, event(1, speed=9))
    assert live.counts()["refused"] == 1
    assert live.counts()["duplicates"] == 0
    [judged] = live.ingest(monitor, event(2, speed=0))
    assert judged.step.event.lost == 1
    assert all(verdict.degraded for verdict in judged.verdicts)
