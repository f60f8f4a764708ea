"""An open session that could not be restored at the start: it is not judged, and can only be read and closed."""

from __future__ import annotations

from typing import NamedTuple

from oracle_server.core.errors import one_line
from oracle_server.history.origins import origin_of, own_name
from oracle_server.history.records import Document, SessionRecord
from oracle_server.sessions.runs import run_of

_COUNTED = ("steps", "held", "refused", "late", "skewed", "skipped", "lost", "denied")


class Unrestored(NamedTuple):
    """A session's record, and why it could not be restored.

    `closing` is its state where it is being closed: so it stands once that is committed.
    """

    record: SessionRecord
    reason: str
    closing: Document | None = None

    @property
    def brief(self) -> str:
        """The first line of the reason."""
        first, *more = self.reason.splitlines() or ["unknown"]
        return one_line(first) + (f" (and {len(more)} more)" if more else "")

    @property
    def trouble(self) -> str:
        """What people are told of it."""
        return f"it could not be restored: {self.reason}"

    @property
    def state(self) -> Document:
        """Its state."""
        return self.closing or bare(self.record) | {"status": "unrestored", "trouble": self.trouble}


def bare(record: SessionRecord) -> Document:
    """A state with the keys of an open session's; what its judges tell is None or left out."""
    return {
        "id": record.id,
        "spec": record.spec,
        "spec_digest": record.digest,
        "gap": None,
        "kind": record.kind,
        "origin": origin_of(record.id),
        "run": run_of(own_name(record.id))[1],
        "status": "open",
        "live": False,
        "idle": False,
        "without_monitor_since": None,
        "clock": None,
        "opened": record.opened,
        "begun": record.begun,
        "closed": None,
        "closed_because": None,
        "trouble": None,
        "monitors": [],
        "streams": [],
        "awaited": None,
        "waiting": None,
        "hold": {"count": 0, "sum": 0, "buckets": []},
        "revising": None,
        "properties": [],
        "disagree": [],
        "counters": dict.fromkeys(_COUNTED),
    }
