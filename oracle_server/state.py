"""How a session stands, as plain data for HTTP."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

from oracle_server.core.reorder import Source

if TYPE_CHECKING:
    from oracle_server.live import LiveSession


def session_state(session: LiveSession, now: int) -> dict[str, Any]:
    """An open session's state; times in nanoseconds since the epoch, durations in nanoseconds."""
    core = session.core
    depths = Counter((step.event.monitor, step.event.stream) for step in core.buffer.held)
    counters: Counter[str] = Counter()
    for judge in core.judges.values():
        for name in ("late", "skewed", "skipped", "lost", "denied"):
            counters[name] += getattr(judge.counters, name)
    return {
        "id": session.id,
        "spec": session.spec.id,
        "spec_digest": session.spec.digest,
        "status": "open",
        "clock": "wall" if core.simulated is None else "sim",
        "opened": session.opened,
        "closed": None,
        "monitors": [
            {
                "name": monitor.name,
                "attached": monitor.attached,
                "connected": monitor.outbox is not None,
                "next": monitor.numbering.next,
                "credit": session.credit.left.get(monitor.name),
            }
            for monitor in session.monitors.values()
        ],
        "streams": [
            {
                "monitor": monitor,
                "stream": stream.name,
                "kind": stream.kind,
                "frontier": frontier,
                "depth": depths[monitor, stream],
                "lag": None if frontier is None else max(0, now - frontier),
            }
            for (monitor, stream), frontier in core.buffer.frontiers.items()
        ],
        "awaited": _awaited(core.buffer.awaited),
        "properties": [
            {
                "id": state.property.id,
                "order": order,
                "outcome": state.outcome.value,
                "first_violation": state.first_violation,
                "violations": state.violations,
                "unknown": state.failures,
                "broken": state.broken,
            }
            for order, judge in core.judges.items()
            for state in judge.properties
        ],
        "counters": {
            "steps": max(judge.counters.steps for judge in core.judges.values()),
            "held": len(core.buffer),
            "refused": session.refused,
            **{name: counters[name] for name in ("late", "skewed", "skipped", "lost", "denied")},
        },
    }


def _awaited(source: Source | None) -> dict[str, str] | None:
    """The stream that everything held waits for."""
    return {"monitor": source[0], "stream": source[1].name, "kind": source[1].kind} if source else None
