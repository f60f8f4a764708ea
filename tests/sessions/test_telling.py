"""Who is told what of revisions: those that asked for them all of them, the others the violations that appear."""

from __future__ import annotations

from pathlib import Path

from oracle_server.core.events import REVISIONS, Event, Step, StreamKey
from oracle_server.core.ordering.numbering import Numbering
from oracle_server.core.records import ExplanationRecord
from oracle_server.core.revisions import Change, Revision
from oracle_server.core.verdicts import Outcome
from oracle_server.history.memory import MemoryHistory
from oracle_server.sessions.monitor import Monitor
from oracle_server.sessions.telling import for_log, news, tell
from oracle_server.wire.incoming import Attach
from tests.sessions.making import GUARD, Kept, registry

LATE = Event(StreamKey("/a", "topic"), "m", 17, 30, 500, {})
WHY: ExplanationRecord = {
    "text": "q does not hold",
    "formula": "p",
    "event": {"stream": "/a", "kind": "topic", "monitor": "m", "seq": 3, "stamp": 40, "signals": {}},
}
RETRACTED = Change(10, "p", 4, 7, Outcome.CURRENTLY_TRUE, degraded=False, retracted=True)
APPEARS = Change(11, "q", 5, 5, Outcome.CURRENTLY_FALSE, degraded=False, violation=True, explanation=WHY)
QUIET = Change(12, "r", 6, 9, None, degraded=True)


def revision(*changes: Change | None) -> Revision:
    step = Step(Event(REVISIONS, "", -1, 30, 500, {}), {}, frozenset(), 30)
    return Revision(step, None, "publication", 501, (), None, first=10, changes=changes, because=(LATE,), causes=1)


def test_a_revision_is_a_frame_for_each_of_its_changes_and_a_violation_that_appears_one_more() -> None:
    frames = news(revision(RETRACTED, APPEARS, QUIET, None))
    assert [(frame["type"], frame["n"]) for frame in frames] == [
        ("revision", 10), ("revision", 11), ("violation", 11), ("revision", 12),
    ]  # fmt: skip
    assert [(frame["type"], frame["n"]) for frame in for_log(frames)] == [("revision", 10), ("violation", 11)]


def test_revisions_are_sent_to_those_that_asked_and_violations_to_all_that_are_connected() -> None:
    monitors = [Monitor(name, "i", Numbering()) for name in ("old", "new", "away")]
    outboxes = [Kept(), Kept()]
    for monitor, outbox in zip(monitors, outboxes, strict=False):
        monitor.outbox = outbox
    monitors[1].revisions = monitors[2].revisions = True
    tell(monitors, news(revision(RETRACTED, APPEARS)))
    sent = [[(frame["type"], frame["n"]) for frame in outbox.frames] for outbox in outboxes]
    assert sent == [[("violation", 11)], [("revision", 10), ("revision", 11), ("violation", 11)]]


async def test_a_monitor_asks_by_the_feature_and_words_that_are_not_known_are_ignored(tmp_path: Path) -> None:
    sessions = registry(MemoryHistory(), tmp_path, GUARD)
    for name, features in (("new", ["colours", "revisions"]), ("old", ["colours"]), ("older", [])):
        wanted = Attach(type="attach", monitor=name, instance="i", session="s", spec="guard", features=features)
        _, monitor = await sessions.attach(wanted, Kept())
        assert monitor.revisions == (name == "new")
