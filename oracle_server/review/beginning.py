"""The session to judge again with: restored from its snapshot, or a fresh one."""

from __future__ import annotations

from collections.abc import Callable

from oracle_server.core.errors import EngineError
from oracle_server.core.session import Session
from oracle_server.history.records import SnapshotRecord


def begin(fresh: Callable[[], Session], snapshot: SnapshotRecord | None) -> tuple[Session, int, str]:
    """Begin a session from its snapshot; returns it, the position of its last step, and an empty text.

    Where there is no snapshot or it can't be used: a fresh session, 0, and the reason.
    """
    core = fresh()
    if snapshot is None:
        return core, 0, "it has no snapshot"
    try:
        core.restore(snapshot.data, snapshot.position * len(core.plan.spec.properties) + 1)
    except (EngineError, KeyError, TypeError, ValueError) as error:
        return fresh(), 0, f"its snapshot can't be used: {error}"
    return core, snapshot.position, ""
