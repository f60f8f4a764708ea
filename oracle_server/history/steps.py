"""Steps in memory: by what they are put in the order of their arrival, and which count for themselves alone."""

from __future__ import annotations

from collections.abc import Sequence

from oracle_server.core.events import StreamKey
from oracle_server.history.records import StoredStep


def arrival(stored: StoredStep) -> tuple[int, str, int, int]:
    """By what steps are put in the order of their arrival."""
    event = stored.step.event
    return event.arrived, event.monitor, event.seq, stored.position


def is_undone(stored: StoredStep, undoing: Sequence[StreamKey]) -> bool:
    """Whether a step is of an event that was denied, of streams whose denied events count for themselves alone."""
    stream = stored.step.event.stream
    denied = stored.decision is not None and stored.decision.choice == "deny"
    return denied and stream in undoing
