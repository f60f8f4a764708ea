"""Violations in words: those that are told, and those that turn out not to stand."""

from __future__ import annotations

from typing import Any, Dict, Mapping

MOST = 1000
"""Violations whose steps are remembered, to be named where they do not stand."""


class Violations:
    """Says lines for people, and remembers where the violations of a session were."""

    def __init__(self) -> None:
        self._places: Dict[Any, str] = {}
        self._session = ""

    def attached(self, session: str) -> None:
        """Forget the violations of another session: its numbers are its own."""
        if session != self._session:
            self._session = session
            self._places.clear()

    def told(self, record: Mapping[str, Any]) -> str:
        """The line of a violation, by its record."""
        first = _first(record)
        self._places[first] = _place(record)
        if len(self._places) > MOST:
            del self._places[next(iter(self._places))]
        return violation_text(record)

    def retracted(self, record: Mapping[str, Any]) -> str:
        """The line of a violation that does not stand, by the revision's record."""
        first = _first(record)
        where = self._places.pop(first, "")
        name = f"{record.get('property')} is not violated{where} (#{first})"
        return f"retracted: {name}: {cause_text(record)}"


def violation_text(record: Mapping[str, Any]) -> str:
    """A violation's record in one line: the property, the event, why, and the verdict's number."""
    explanation = record.get("explanation") or {}
    known = {**dict.fromkeys(("step", "stream", "kind", "seq", "monitor"), "?"), **record}
    event = "step {step}, {stream} ({kind} {seq} of {monitor})".format_map(known)
    text = explanation.get("text") or f"{record.get('property')} does not hold at {event}"
    since = f"; known since {cause_text(record)}" if record.get("because") else ""
    return f"violation: {text}{since} (#{record.get('n')})"


def cause_text(record: Mapping[str, Any]) -> str:
    """The late events that a revision was made for: the first with its delay, and how many more."""
    causes = record.get("because") or [{}]
    known = {**dict.fromkeys(("stream", "kind", "seq", "monitor"), "?"), **causes[0]}
    event = "{stream} ({kind} {seq} of {monitor})".format_map(known)
    stamp, arrived = known.get("stamp"), record.get("arrived")
    delay = 0 if stamp is None or arrived is None else max(0, arrived - stamp) // 10**6
    more = (record.get("causes") or 1) - 1
    return (
        f"{event} came {f'{delay} ms ' if delay else ''}late{f', and {more} more' if more else ''}"
    )


def first_text(state: Mapping[str, Any]) -> str:
    """Where the first violation of a property was: its step and time; older servers do not tell."""
    step, stamp = state.get("first_violation_step"), state.get("first_violation_at")
    if stamp is None:
        return "-"
    return time_text(stamp) if step is None else f"step {step}, {time_text(stamp)}"


def time_text(stamp: int) -> str:
    """A time (ns) as the server tells it: of the day in UTC, in seconds if the clock is near 0."""
    if stamp < 10**18:
        return f"{stamp / 10**9:.3f} s"
    second = stamp // 10**9 % 86_400
    day = f"{second // 3600:02}:{second // 60 % 60:02}:{second % 60:02}"
    return f"{day}.{stamp // 10**6 % 1000:03}Z"


def _first(record: Mapping[str, Any]) -> Any:
    """The number of the verdict at which a property becomes negative, or does not after all."""
    return (record.get("revises") or {}).get("from", record.get("n"))


def _place(record: Mapping[str, Any]) -> str:
    """Where a violation is; a revision's record has no step, and the time of another event."""
    step, stamp = record.get("step"), record.get("stamp")
    if record.get("revises"):
        step, stamp = None, ((record.get("explanation") or {}).get("event") or {}).get("stamp")
    at = "" if stamp is None else time_text(stamp)
    if step is not None:
        at = f"step {step} ({at})" if at else f"step {step}"
    return f" at {at}" if at else ""
