"""Messages that could not be read: which event tells that they are lost."""

from __future__ import annotations

import json
from pathlib import Path

from oracle_adapter.logfile import LogFile
from oracle_adapter.outbox import Outbox
from oracle_adapter.stats import Stats
from oracle_adapter.unread import TOLD_WITHIN, Unread


def test_an_event_of_the_stream_tells_them_first_and_one_of_another_stream_later() -> None:
    now = 5.0
    unread = Unread(lambda: now)
    assert not unread
    unread.add()
    unread.add()
    now += TOLD_WITHIN / 2
    assert unread.overdue() == 0
    assert unread.take() == 2
    unread.add()
    now += TOLD_WITHIN
    assert (unread.overdue(), unread.overdue(), unread.take()) == (1, 0, 0)


def test_the_next_event_of_the_link_tells_what_was_lost_before() -> None:
    outbox = Outbox(3, Stats())
    assert (outbox.miss(0), outbox.miss(2), outbox.miss(0)) == (False, True, True)
    first, second = outbox.put(1, "{}", lost=1), outbox.put(2, "{}")
    assert not outbox.miss(0)
    assert first is not None
    assert second is not None
    assert (first.lost, second.lost) == (3, 0)


def test_the_next_line_of_a_log_tells_what_was_lost_before(tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    described = {"streams": [], "spec": "s", "spec_digest": "d"}
    log = LogFile(str(path), described, "uav1", lambda *_: None, lambda _: None)
    assert (log.lost(0), log.lost(2), log.lost(0)) == (False, True, True)
    assert log.send("/a", "topic", 1, {}, lost=1)
    assert not log.lost(0)
    assert log.send("/a", "topic", 2, {})
    log.close()
    assert [json.loads(line).get("lost") for line in path.read_text().splitlines()] == [3, None]
