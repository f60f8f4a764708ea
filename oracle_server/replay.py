"""A recorded trace through the same session as a live one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.spec import By, Spec
from oracle_server.core.verdicts import Judged
from oracle_server.engines.choice import make_engines
from oracle_server.trace import Trace

_FOR_EVER = 2**63


class Replay:
    """Judges a trace against a spec; iterate it for what was judged, then ask for the summary."""

    def __init__(self, spec: Spec, trace: Trace, by: By | None = None) -> None:
        """`by` overrides the order that the spec asks for."""
        ordering = replace(spec.ordering, by=by) if by else spec.ordering
        self.spec = replace(spec, ordering=ordering)
        self.events = 0
        self._trace = trace
        self._session: Session | None = None

    def __iter__(self) -> Iterator[Judged]:
        """What is judged, in order. Raises `TraceError` where the trace can't be used."""
        monitors: set[str] = set()
        for event in self._trace:
            session = self._session = self._session or self._open()
            self.events += 1
            if event.monitor not in monitors:
                monitors.add(event.monitor)
                session.attach(event.monitor, self.spec.by_key, event.arrived)
            yield from session.ingest(event)
        if self._session is not None:
            yield from self._session.finish(self._session.now)

    def _open(self) -> Session:
        """A session; where the trace does not say when events arrived, no time passes and nothing is too far ahead."""
        spec = self.spec
        if not self._trace.clocked:
            ordering = replace(spec.ordering, max_delay=None, max_skew=_FOR_EVER, capacity=_FOR_EVER)
            spec = replace(spec, ordering=ordering)
        ready = plan(spec)
        return Session(ready, make_engines(ready))

    @property
    def violated(self) -> bool:
        """Whether any property became negative."""
        return any(state["violations"] for state in self._states().values())

    def summary(self) -> dict[str, Any]:
        """The counts of the whole run, and how each property stands at its end.

        With both orders, a property judged by arrival is listed as `name (arrival)`.
        """
        states = self._states()
        counters = [judge.counters for judge in self._session.judges.values()] if self._session else []
        return {
            "events": self.events,
            "ignored": sum(self._trace.ignored.values()),
            "violations": sum(state["violations"] for state in states.values()),
            "late": sum(c.late for c in counters),
            "properties": states,
        }

    def _states(self) -> dict[str, dict[str, Any]]:
        if self._session is None:
            blank = {"outcome": "unknown", "first_violation": None, "violations": 0, "unknown": 0}
            return {p.id: dict(blank) for p in self.spec.properties}
        both = len(self._session.judges) > 1
        return {
            state.property.id + (" (arrival)" if both and order == "arrival" else ""): {
                "outcome": state.outcome.value,
                "first_violation": state.first_violation,
                "violations": state.violations,
                "unknown": state.failures,
            }
            for order, judge in self._session.judges.items()
            for state in judge.properties
        }
