"""Of which sessions something is asked."""

from __future__ import annotations

from typing import NamedTuple

from oracle_server.history.origins import origin_of
from oracle_server.history.records import SessionRecord


class Whose(NamedTuple):
    """Specs and sessions by their ids, None for any; `origin`: those that are forwarded from this robot."""

    specs: frozenset[str] | None = None
    sessions: frozenset[str] | None = None
    origin: str | None = None

    def has(self, session: SessionRecord) -> bool:
        """Whether a session is one of these."""
        return (
            (self.specs is None or session.spec in self.specs)
            and (self.sessions is None or session.id in self.sessions)
            and (self.origin is None or origin_of(session.id) == self.origin)
        )


ALL = Whose()
