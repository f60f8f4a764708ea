"""Where a session that is judged again begins: out of its snapshot, or afresh."""

from __future__ import annotations

from collections.abc import Callable

from oracle_server.core.errors import EngineError
from oracle_server.core.session import Session
from oracle_server.history.records import SnapshotRecord


def begin(fresh: Callable[[], Session], snapshot: SnapshotRecord | None) -> tuple[Session, int, str]:
    """A session as its snapshot has it, and the position of the last step before; or a fresh one, 0, and why."""
    core = fresh()
    if snapshot is None:
        return core, 0, "it has no snapshot"
    try:
        core.restore(snapshot.data, snapshot.position * len(core.plan.spec.properties) + 1)
    except (EngineError, KeyError, TypeError, ValueError) as error:
        return fresh(), 0, f"its snapshot is of no use: {error}"
    return core, snapshot.position, ""
