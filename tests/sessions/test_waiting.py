"""A live session tells that what has come for long is not judged, and what that waits for."""

from __future__ import annotations

from pathlib import Path

from oracle_server.core.spec import SECOND
from oracle_server.history.memory import MemoryHistory
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.status import session_state
from oracle_server.sessions.summary import brief
from tests.sessions.making import Kept, attach, event, registry

SPEC = """
id: spec
ordering: {by: both, max_delay: none}
streams:
  - {topic: /a, signals: {v: msg.v}}
  - {topic: /b}
properties:
  - {id: small, formula: 'not {v > 10}'}
"""


def caveats(live: LiveSession, later: int) -> dict[str, list[str]]:
    return {row["order"]: row["caveats"] for row in session_state(live, live.clock.now() + later)["properties"]}


async def test_what_is_not_judged_for_long_is_told(tmp_path: Path) -> None:
    """Violations were held for hours for a stream that was silent, and all was said to hold."""
    sessions = registry(MemoryHistory(), tmp_path, SPEC)
    live, monitor = await sessions.attach(attach("s", "spec", streams=["/a", "/b"]), Kept())
    for seq, (stream, v) in enumerate((("/b", 0), ("/a", 11)), 1):
        live.ingest(monitor, event(seq, stream).model_copy(update={"data": {"v": v}, "stamp": live.clock.now()}))
    assert caveats(live, 5 * SECOND) == {"publication": [], "arrival": []}
    told = caveats(live, 11 * SECOND)
    (text,) = told["publication"]
    assert text.startswith("since ")
    assert text.endswith(" UTC what comes is not judged: it waits for /b of m")
    assert told["arrival"] == [], "where nothing is put in order nothing waits"
    assert brief(session_state(live, live.clock.now() + 11 * SECOND))["caveats"] == [text]
