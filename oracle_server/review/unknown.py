"""Why a verdict is no judgement, in words: as far as its history tells, and no further."""

from __future__ import annotations

from oracle_server.core.judging.presence import grace
from oracle_server.core.plan import Plan
from oracle_server.core.spec import SECOND, Spec
from oracle_server.core.verdicts import Outcome
from oracle_server.history.port import Reading
from oracle_server.history.records import StoredStep

_ENGINE = "the engine failed"


async def why_unknown(
    history: Reading, session: int, stored: StoredStep, index: int, ready: Plan, begun: int | None
) -> str:
    """Why the outcome of a property, by its index, is unknown at a step or a deadline. Raises `HistoryError`."""
    known = _known(stored, index, ready, begun)
    if known is not None or not stored.is_tick:
        return known or _guessed(stored, index, ready)
    undoing = [key for key, stream in ready.streams.items() if stream.undoes]
    last = await history.last_counted(session, stored.order, stored.position, undoing)
    if last is None:
        return "no event had been judged when it was told"
    step = await history.step(session, last)
    if step is None or step.outcomes[index] is not Outcome.UNKNOWN or _is_moved(stored, step, index):
        return f"it was unknown before already, or {_guessed(stored, index, ready)}"
    why = _known(step, index, ready, begun) or _guessed(step, index, ready)
    return f"it was unknown at step {step.number} already: {why}"


def _is_moved(deadline: StoredStep, step: StoredStep, index: int) -> bool:
    """Whether the last step that was judged before a deadline may not be the one that stands before it."""
    return step.place is not None or index in deadline.revised


def _known(stored: StoredStep, index: int, ready: Plan, begun: int | None) -> str | None:
    """What its own row tells of it, None where that is nothing."""
    prop, step = ready.spec.properties[index], stored.step
    view = ready.silent[index] if stored.is_tick else ready.streams[step.event.stream].views[index]
    failed = ", ".join(sorted(step.failed & view.reads))
    if failed:
        return f"computing failed for {failed}"
    allowed, time = grace(prop.formula, prop.time), step.event.arrived if stored.order == "arrival" else step.time
    if allowed and begun is not None and time < begun + allowed:
        return f"the session began less than {allowed / SECOND:g} s before, so that nothing is missing yet"
    return None


def _guessed(stored: StoredStep, index: int, ready: Plan) -> str:
    """What it may be, where nothing tells which."""
    spec, view = ready.spec, ready.silent[index]
    derived = spec.derived_of(spec.properties[index])
    held = frozenset[str]() if stored.is_tick else _held(spec) & view.reads  # a deadline's own row has these
    found = [f"a sample of {' or '.join(derived)} has failed"] if derived else []
    found += [f"what is held of {' or '.join(sorted(held))} had failed"] if held else []
    return f"{', '.join(found)}, or the engine did" if found else _ENGINE


def _held(spec: Spec) -> frozenset[str]:
    return frozenset(name for stream in spec.streams for name in stream.hold)
