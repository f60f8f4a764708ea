"""What is to be said of a property that was violated, in reports that have an entry a property."""

from __future__ import annotations

from typing import Any

from oracle_server.core.naming import step_name
from oracle_server.core.units import counted
from oracle_server.replay.episodes import line
from oracle_server.replay.run import Replay


def violated_text(state: dict[str, Any], episodes: int) -> str:
    """How often a property was violated, and first when, by its state."""
    first = step_name(state["first_violation_step"], state["first_violation_at"])
    return f"violated {_times(state['violations'])} in {counted(episodes, 'episode')}, first at {first}"


def episode_lines(replay: Replay, name: str) -> list[str]:
    """The episodes of a property as it is listed, a line each."""
    both = replay.spec.ordering.by == "both"
    names = (
        (stored.property + " (arrival)" * (both and stored.order == "arrival"), stored)
        for stored in replay.episodes.all()
    )
    return [line(stored) for known, stored in names if known == name]


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
