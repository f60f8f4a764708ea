"""What of a session is an alarm: at most one for each property and episode."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, Protocol

from oracle_server.core.errors import one_line
from oracle_server.core.revisions import Revision
from oracle_server.core.session import Session
from oracle_server.core.verdicts import Judged, Outcome, Verdict, explain
from oracle_server.history.records import SessionRecord
from oracle_server.sessions.summary import WHY_DEGRADED

_LONGEST = 2_000

Alarm = dict[str, Any]


class Sink(Protocol):
    """Where alarms go."""

    def wants(self, what: str) -> bool:
        """Whether anybody is told of such alarms."""
        ...

    def send(self, alarm: Alarm) -> None:
        """Take an alarm; returns at once."""
        ...


class Degraded:
    """Tells where the verdicts of a property become degraded: most are so to the end, and are told once.

    Those that were not degraded for less than a gap between (ns), as of a stream that is bypassed now and then, go on.
    """

    def __init__(self, gap: int) -> None:
        self._gap = gap
        self._last: dict[str, int] = {}
        self._going_on: set[str] = set()

    def begins(self, prop: str, stamp: int, *, degraded: bool) -> bool:
        """Note a verdict at a time (ns), and whether it is degraded; whether that begins with it."""
        if not degraded:
            self._going_on.discard(prop)
            return False
        last = self._last.get(prop)
        began = prop not in self._going_on and (last is None or stamp - last >= self._gap)
        self._last[prop] = stamp if last is None else max(last, stamp)
        self._going_on.add(prop)
        return began


class SessionAlarms:
    """The alarms of one session, of the order that decides."""

    def __init__(self, record: SessionRecord, core: Session, sink: Sink) -> None:
        """Give alarms to `sink`; what is final of the session already is told no more."""
        order, judge = next(iter(core.judges.items()))
        self._record, self._order, self._sink = record, order, sink
        self._states = {state.property.id: state for state in judge.told.properties}
        self._broken: set[str] = set()
        self._degraded = Degraded(core.plan.spec.gap)
        self._final = {s.property.id for s in judge.told.properties if s.outcome is Outcome.FALSE}
        self._wants = {what: sink.wants(what) for what in ("violation", "final", "degraded")}

    def look(self, judged: Iterable[Judged]) -> list[Alarm]:
        """The alarms of rows; to be sent once they are committed."""
        found: list[Alarm] = []
        for item in judged:
            if item.order != self._order:
                continue
            if self._wants["violation"] and item.episodes:
                found += self._violations(item)
            if (self._wants["final"] or self._wants["degraded"]) and not isinstance(item, Revision):
                found += self._of(item)
        return found

    def send(self, alarms: Iterable[Alarm]) -> None:
        """Send alarms whose rows are committed."""
        for alarm in alarms:
            self._sink.send(alarm)

    def _violations(self, item: Judged) -> Iterator[Alarm]:
        """The episodes that begin with a row, or in the pass that it ends."""
        for change in item.episodes:
            if change.kind != "begins" or change.moved:
                continue
            name, episode = self._record.properties[change.index], change.episode
            text, number, stamp = change.text, None, episode.began
            if text is None:
                why = explain(item, item.verdicts[change.index])
                text, number, stamp = why and why["text"], item.number, item.step.stamp
            outcome = Outcome.FALSE if episode.final else Outcome.CURRENTLY_FALSE
            place = {"n": episode.first, "step": number, "stamp": stamp, "outcome": outcome.value}
            yield self._alarm(
                "violation", property=name, **place, text=one_line((text or f"{name} is violated")[:_LONGEST])
            )

    def _of(self, item: Judged) -> Iterator[Alarm]:
        for verdict in item.verdicts:
            if verdict.outcome is Outcome.FALSE and verdict.property not in self._final and self._wants["final"]:
                self._final.add(verdict.property)
                yield self._about("final", item, verdict, f"{verdict.property} is violated for good")
            if self._wants["degraded"] and (text := self._doubt(item, verdict)):
                yield self._about("degraded", item, verdict, text)

    def _doubt(self, item: Judged, verdict: Verdict) -> str | None:
        """Why a property is degraded from a verdict on, or not judged any more; None where that does not begin."""
        name = verdict.property
        begins = self._degraded.begins(name, item.step.stamp, degraded=verdict.degraded)
        if name in self._broken:
            return None
        broken = self._states[name].broken
        if broken is not None and verdict.outcome is Outcome.UNKNOWN:
            self._broken.add(name)
            return one_line(f"{name} is no longer judged: {broken}"[:_LONGEST])
        if not begins:
            return None
        why = "a stream that it guards or reads is bypassed" if verdict.bypassed else WHY_DEGRADED
        return f"the verdicts of {name} are degraded: {why}"

    def _about(self, what: str, item: Judged, verdict: Verdict, text: str) -> Alarm:
        place = {"n": verdict.n, "step": item.number, "stamp": item.step.stamp, "outcome": verdict.outcome.value}
        return self._alarm(what, property=verdict.property, **place, text=text)

    def _alarm(self, what: str, **more: Any) -> Alarm:
        return {"alarm": what, "session": self._record.id, "spec": self._record.spec, **more}


def session_ended(record: SessionRecord, state: dict[str, Any]) -> Alarm:
    """The alarm of a session that is closed, by its last state; `violations` is None where that does not tell them."""
    violated = {p["id"]: p["violations"] for p in state["properties"] if p["violations"]}
    text = f"session {record.id} is closed: {state['closed_because']}"
    if state["trouble"]:
        text = one_line(f"{text}; {state['trouble']}"[:_LONGEST])
    return {
        "alarm": "session_ended",
        "session": record.id,
        "spec": record.spec,
        "closed": state["closed"],
        "because": state["closed_because"],
        "continued_by": state["continued_by"],
        "violations": violated if state["properties"] else None,
        "text": text,
    }
