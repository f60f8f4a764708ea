"""A session's trace from its history: a line for each event or tick, in order of arrival, with its judged places.

The history stores the signals of a message, and not the message: a line has `signals` instead of `data`, the answers of
external oracles, and what was decided where a monitor asked.
"""

from __future__ import annotations

from collections.abc import AsyncGenerator, Sequence
from contextlib import aclosing
from functools import partial

from oracle_server.history.port import Reading
from oracle_server.history.records import Document, SessionRecord, StoredStep
from oracle_server.specfiles.load import parse_spec


async def trace_lines(history: Reading, session: int) -> AsyncGenerator[list[Document], None]:
    """The lines of a session's committed steps, page by page. Raises `HistoryError`."""
    opened = await history.session(session)
    lines = _Lines(opened, await _external(history, opened))
    async with aclosing(history.by_arrival(session)) as pages:
        async for page in pages:
            yield await history.in_thread(partial(lines.take, page))
    if lines.open:
        yield lines.close()


class _Lines:
    """The lines of steps that come by arrival: all steps of an event make one line, or one for each of its rows."""

    def __init__(self, opened: SessionRecord | None, external: dict[int, str]) -> None:
        self.open: dict[int | None, Document] = {}
        """The lines of the last event, by its rows, to which further steps may belong."""
        self._event = "", 0
        self._external = external
        self._begun = None if opened is None else opened.begun
        self._properties = () if opened is None else opened.properties

    def take(self, page: Sequence[StoredStep]) -> list[Document]:
        """The lines that are complete with the next steps."""
        complete = []
        for stored in page:
            event = stored.step.event
            if stored.is_tick or self._event != (event.monitor, event.seq):
                complete += self.close()
                self._event = (event.monitor, event.seq)
            line = self.open.get(event.row)
            if line is None:
                line = self.open[event.row] = event_line(stored) | (
                    {} if self._begun is None else {"begun": self._begun}
                )
                self._begun = None
            line["places"].append(_place(stored, self._external, self._properties))
            if stored.order == "publication":
                line |= {"passed": stored.passed, "why": stored.why}
            line |= _decided(stored)
        return complete

    def close(self) -> list[Document]:
        """The lines of the last event, to which nothing more belongs."""
        found, self.open = [*self.open.values()], {}
        return found


def event_line(stored: StoredStep) -> Document:
    """A step's event as the line of a trace, without its places."""
    step, event = stored.step, stored.step.event
    return {
        "stream": event.stream.name,
        "kind": event.stream.kind,
        "monitor": event.monitor,
        "seq": event.seq,
        "stamp": step.stamp,
        "arrived": event.arrived,
        "source": event.source,
        "call": event.call,
        "lost": event.lost,
        "ask": event.ask,
        "passed": stored.passed,
        "why": stored.why,
        "signals": step.signals,
        "failed": sorted(step.failed),
        "places": [],
        **({} if event.row is None else {"row": event.row}),
        **event.marks,
        **_decided(stored),
    }


def _decided(stored: StoredStep) -> Document:
    """What was decided at a step, empty where nothing was asked."""
    decision = stored.decision
    return {} if decision is None else {"decision": decision.choice, "denied_by": decision.denied_by}


def _place(stored: StoredStep, external: dict[int, str], properties: Sequence[str]) -> Document:
    step = stored.step
    place: Document = {
        "position": stored.position,
        "order": stored.order,
        "judged": stored.judged,
        "late": step.late,
        "skewed": step.skewed,
        "forced": step.forced,
        "skipped": step.skipped,
        "degraded": stored.lost,
    }
    if step.released is not None:
        place["released"] = step.released
    if stored.place is not None:
        place["place"] = stored.place
    if stored.bypassed:
        place["bypassed"] = [properties[i] for i in stored.bypassed]
    return place | {"said": _answers(stored, external)} if external else place


async def _external(history: Reading, opened: SessionRecord | None) -> dict[int, str]:
    """The ids of a session's external properties, by their indexes; none while the session is not committed."""
    if opened is None or "external" not in opened.text:
        return {}
    properties = (await history.in_thread(partial(parse_spec, opened.text, ""))).spec.properties
    return {i: p.id for i, p in enumerate(properties) if p.external is not None}


def _answers(stored: StoredStep, external: dict[int, str]) -> dict[str, tuple[str, str, bool]]:
    """The answers of external oracles to a step, and whether they may have missed something before it."""
    return {name: (stored.outcomes[i].value, _reason(stored, i), stored.degraded[i]) for i, name in external.items()}


def _reason(stored: StoredStep, index: int) -> str:
    why = stored.explanations.get(index)
    reasons = why.get("reasons") if why else None
    return reasons[0]["text"] if reasons else "answered so"
