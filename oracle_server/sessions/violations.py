"""Violations in the server's log, and those that were retracted: each with its text, but for a flood of them."""

from __future__ import annotations

from collections.abc import Iterable

import structlog

from oracle_server.core.errors import one_line
from oracle_server.core.naming import retraction_text
from oracle_server.core.records import VerdictRecord
from oracle_server.process.clock import Clock

log = structlog.get_logger()

_MOST, _WITHIN = 20, 10 * 10**9
"""Violations of a session that are logged within so many nanoseconds."""
_LONGEST = 2_000
"""Characters of a violation's text that are logged: it quotes what robots say, which may be a megabyte."""


class ViolationLog:
    """Logs one session's violations; of a flood the first ones, since a log is for people. The history has them all."""

    def __init__(self, session: str, clock: Clock) -> None:
        self._session, self._clock = session, clock
        self._since = self._logged = 0

    def add(self, records: Iterable[VerdictRecord]) -> None:
        """Log committed violations, and revisions that retract one."""
        for record in records:
            now = self._clock.now()
            if now - self._since >= _WITHIN:
                self._since, self._logged = now, 0
            self._logged += 1
            if self._logged <= _MOST:
                log.warning(_line(record), session=self._session, n=record["n"])
            elif self._logged == _MOST + 1:
                log.warning("more violations are in the history, and not logged for now", session=self._session)


def _line(record: VerdictRecord) -> str:
    if record.get("retracted"):
        return f"retracted: {one_line(retraction_text(record))}"
    why = record["explanation"]
    text = f"{record['property']} is violated" if why is None else why["text"]
    return f"violation: {_shortened(text)}"


def _shortened(text: str) -> str:
    line = one_line(text[:_LONGEST])
    if len(text) <= _LONGEST and len(line) <= _LONGEST:
        return line
    return f"{line[:_LONGEST]}… (the history has all of it)"
