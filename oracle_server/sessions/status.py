"""The state of a session, as plain data for HTTP: what stands."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from itertools import accumulate
from typing import Any

from oracle_server.core.events import Source, Step
from oracle_server.core.judging.asked import unasked
from oracle_server.core.revise.lateness import Lateness
from oracle_server.core.session import Session
from oracle_server.core.spec import SECOND
from oracle_server.core.tally import BOUNDS, HoldTimes, StreamCounts
from oracle_server.core.verdicts import json_number
from oracle_server.sessions.counters import counted
from oracle_server.sessions.doubled import doubled
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.runs import run_of
from oracle_server.sessions.standing import caveats

_AT_ONCE = 200
"""Rows that are made in one turn, of some 5 us each."""
_LONG = 10 * SECOND
"""For how long (ns) what came waits for its turn until properties say so: what they tell is not of now."""
_FEW = 10
"""Streams that nobody observes any more, of which the properties tell."""


def session_state(session: LiveSession, now: int) -> dict[str, Any]:
    """An open session's state; times in nanoseconds since the epoch, durations in nanoseconds."""
    return _stated(session, now, list(_monitors(session)), list(_streams(session.core, now)))


def _stated(
    session: LiveSession, now: int, monitors: list[dict[str, Any]], streams: list[dict[str, Any]]
) -> dict[str, Any]:
    """The state with the rows of its monitors and streams."""
    trouble = session.keeping.trouble
    return {
        "id": session.id,
        "spec": session.spec.id,
        "spec_digest": session.spec.digest,
        "gap": session.spec.gap,
        "kind": session.record.kind,
        "origin": None,
        "run": run_of(session.id)[1],
        "status": "open",
        "live": session.presence.is_live,
        "idle": session.presence.is_idle(session.clock.now()),
        "without_monitor_since": session.presence.without_since,
        "opened": session.opened,
        "closed": None,
        "closed_because": None,
        "trouble": None if trouble is None else f"nothing more of it can be kept: {trouble}",
        "monitors": monitors,
        **_told_of_monitors(session, _judged(session.core, now, session.ledger.refused, streams), now),
    }


def _told_of_monitors(session: LiveSession, state: dict[str, Any], now: int) -> dict[str, Any]:
    """The state with the caveats of properties that come from their monitors.

    They are of those that left, of what one holds and another's events do not see, of what several hear, of clocks, and
    of what is not judged for want of others.
    """
    lacks, misses, twice = _lacking(session), session.presence.apart.missing, doubled(session)
    apart = [*_apart(session), *_unjudged(session, now)]
    for row in state["properties"] if lacks or misses or twice or apart else ():
        row["caveats"] += lacks.get(row["id"], ())
        row["caveats"] += misses.get(row["id"], ())
        row["caveats"] += twice.get(row["id"], ())
        row["caveats"] += [text for text, ids in apart if row["order"] == "publication" and row["id"] in ids]
    return state


def _apart(session: LiveSession) -> Iterator[tuple[str, frozenset[str]]]:
    """What is to be said of clocks that are not in step with the server's, and of which properties."""
    properties = session.spec.properties if session.core.simulated is None else ()
    for name in (monitor.name for monitor in session.monitors.values() if monitor.outbox is not None):
        ahead = session.core.clocks.apart(name)
        seconds = max(1, round(abs(ahead) / SECOND))
        if ahead > 0:
            told = f"the clock of {name} is {seconds} s ahead of the server's: its events are ordered as they arrive"
            yield told, frozenset(p.id for p in properties)
        elif ahead < 0:
            told = f"the clock of {name} is {seconds} s behind the server's, or what it sends takes so long"
            timed = frozenset(p.id for p in properties if p.time == "seconds")
            yield f"{told}: deadlines run out before what meets them comes", timed


def _unjudged(session: LiveSession, now: int) -> Iterator[tuple[str, frozenset[str]]]:
    """That what has come for long is not judged yet, what that waits for, and the properties, which are all."""
    for step, awaited in _awaiting(session.core):
        if now - step.event.came >= _LONG:
            since = datetime.fromtimestamp(step.event.came // SECOND, UTC)
            told = f"since {since:%F %T} UTC what comes is not judged: it waits for {awaited}"
            yield told, frozenset(p.id for p in session.spec.properties)


def _lacking(session: LiveSession) -> dict[str, list[str]]:
    """Which streams nobody observes any more that a property reads, by its id, where other monitors are there."""
    gone, is_any = set(session.claimed), False
    for monitor in session.monitors.values():
        if monitor.attached and monitor.streams:
            is_any = True
            gone.difference_update(monitor.streams)
        if not gone:
            break
    left = sorted(gone) if is_any else []
    lacks: dict[str, list[str]] = {}
    for key in left[:_FEW]:
        for index in session.core.plan.readers.get(key.name, ()):
            lacks.setdefault(session.spec.properties[index].id, []).append(f"no monitor observes {key} any more")
    return lacks


async def present_state(session: LiveSession, now: int) -> dict[str, Any]:
    """The same of one that is not being closed: its `trouble` says too that nothing is judged at present.

    Of many monitors it is made in turns, between which others are served.
    """
    monitors = await _in_turns(_monitors(session))
    state = _stated(session, now, monitors, await _in_turns(_streams(session.core, now)))
    if state["trouble"] is None and (failure := session.keeping.failure) is not None:
        state["trouble"] = f"nothing of it is judged while the history can't be written: {failure}"
    return state


async def _in_turns(rows: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    made = []
    for row in rows:
        made.append(row)
        if len(made) % _AT_ONCE == 0:
            await asyncio.sleep(0)
    return made


def judged_state(core: Session, now: int, refused: int) -> dict[str, Any]:
    """What of a state its judges and its order tell, at a time (ns); so many events were refused."""
    return _judged(core, now, refused, list(_streams(core, now)))


def _judged(core: Session, now: int, refused: int, streams: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "clock": "wall" if core.simulated is None else "sim",
        "begun": core.begun,
        "streams": streams,
        "awaited": _awaited(core.buffer.awaited),
        "waiting": _waiting(core, now),
        "hold": _hold(core.holds),
        "revising": None if core.lateness is None else _revising(core.lateness),
        "properties": list(_properties(core)),
        "disagree": _disagree(core),
        "counters": _counters(core, refused),
    }


def _monitors(session: LiveSession) -> Iterator[dict[str, Any]]:
    for monitor in [*session.monitors.values()]:  # others may come meanwhile
        yield {
            "name": monitor.name,
            "attached": monitor.attached,
            "connected": monitor.outbox is not None,
            "next": monitor.numbering.next,
            "credit": session.credit.left.get(monitor.name),
            "streams": [report.model_dump() for report in monitor.reports.values()],
        }


def _properties(core: Session) -> Iterator[dict[str, Any]]:
    """Each property, in each order."""
    for order, judge in core.judges.items():
        told = judge.told
        for i, state in enumerate(told.properties):
            yield {
                "id": state.property.id,
                "order": order,
                "outcome": state.outcome.value,
                "first_violation": state.first_violation,
                "first_violation_step": state.first_violation_step,
                "first_violation_at": state.first_violation_at,
                "violations": state.violations,
                "pending": state.pending,
                "unknown": state.failures,
                "degraded": told.is_degraded(i),
                "broken": state.broken,
                "complaint": state.complaint,
                "unasked": None if (idle := unasked(state.watch, state.outcome)) is None else idle.part,
                "caveats": caveats(core, i),
                "robustness": json_number(state.robustness),
            }


def _counters(core: Session, refused: int) -> dict[str, int]:
    """The counts of the order that decides, as in the metrics: each event once."""
    counts = counted(core, refused)
    return {
        "steps": max(judge.told.counters.steps for judge in core.judges.values()),
        "held": len(core.buffer),
        **{name: counts[name] for name in ("refused", "late", "skewed", "skipped", "lost", "denied", "revised")},
    }


def _streams(core: Session, now: int) -> Iterator[dict[str, Any]]:
    """Each stream of a monitor that is ordered, or has counts or held events; `lag` (ns) is in the session's time."""
    depths = Counter((step.event.monitor, step.event.stream) for step in core.buffer.held)
    order = core.buffer
    present = now if core.simulated is None else core.simulated.now
    for source in dict.fromkeys((*order.sources, *depths, *core.counts)):
        monitor, stream = source
        frontier, counts = order.frontier(source), core.counts.get(source, StreamCounts())
        publishers, forgotten = order.publishers(source)
        yield {
            "monitor": monitor,
            "stream": stream.name,
            "kind": stream.kind,
            "frontier": frontier,
            "depth": depths[source],
            "lag": None if frontier is None or present is None else max(0, present - frontier),
            "late": counts.late,
            "lost": counts.lost,
            "duplicates": counts.duplicates,
            "publishers": publishers,
            "forgotten": forgotten,
        }


def _awaited(source: Source | None) -> dict[str, str] | None:
    """The stream that all held events wait for."""
    return {"monitor": source[0], "stream": source[1].name, "kind": source[1].kind} if source else None


def _waiting(core: Session, now: int) -> str | None:
    """What the session waits for, and how long already, as text; None where it does not wait."""
    return "; ".join(f"held {_age(step, now)} ms for {awaited}" for step, awaited in _awaiting(core)) or None


def _awaiting(core: Session) -> Iterator[tuple[Step, str]]:
    """The steps whose turn it is, and what they wait for: oracles elsewhere, and a stream that the order waits for."""
    if core.asking and (first := core.asking.first):
        for index in sorted(first.missing):
            prop = core.plan.spec.properties[index]
            assert prop.external is not None  # noqa: S101 -- it was asked
            yield first.step, f"the oracle at {prop.external.url} of property {prop.id}"
    source, oldest = core.buffer.awaited, next(iter(core.buffer.held), None)
    if source is not None and oldest is not None:
        yield oldest, f"{source[1]} of {source[0]}"


def _age(step: Step, now: int) -> int:
    """The time since an event arrived, in ms."""
    event = step.event
    return max(0, now - event.came) // 10**6


def _revising(lateness: Lateness) -> dict[str, Any]:
    """How late events are put in their places; `shorter`: more steps than are kept lie within the horizon (ns)."""
    judge = lateness.judge
    return {
        "horizon": judge.horizon,
        "kept": len(judge.keeping),
        "shorter": judge.keeping.crowded,
        "placed": lateness.placed,
        "beyond": lateness.beyond,
        "passes": lateness.passes,
        "waiting": lateness.waiting,
        "going": judge.is_going,
    }


def _hold(holds: HoldTimes) -> dict[str, Any]:
    """How long events were held (ns): each bucket counts those held for `le` or less; null is no bound."""
    counts = accumulate(holds.buckets)
    buckets = [{"le": bound, "count": count} for bound, count in zip((*BOUNDS, None), counts, strict=True)]
    return {"count": holds.count, "sum": holds.total, "buckets": buckets}


def _disagree(core: Session) -> list[str]:
    """The properties with different violations in the two orders: a sign of a slow network, not of a faulty node."""
    judged = [judge.told.properties for judge in core.judges.values()]
    return [states[0].property.id for states in zip(*judged, strict=True) if len({s.violations for s in states}) > 1]
