"""What a judge has counted, and how it stands for those who ask."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from oracle_server.core.episode import Following
from oracle_server.core.judging.property_state import PropertyState


@dataclass(slots=True)
class Counters:
    """What a judge has counted; `steps` are judged events, `skipped` those that were not, `ticks` the recorded ones.

    `revised` are the changes of what stood, and `retracted` the violations among what did not stand then.
    """

    steps: int = 0
    ticks: int = 0
    late: int = 0
    skewed: int = 0
    skipped: int = 0
    lost: int = 0
    denied: int = 0
    revised: int = 0
    retracted: int = 0


class Told(NamedTuple):
    """How a judge stands for those who ask at any time."""

    properties: Sequence[PropertyState]
    counters: Counters
    following: Following
    degraded: bool
    """Whether what was lost, skipped or judged too early may make all that is judged since wrong."""

    def is_degraded(self, index: int) -> bool:
        """Whether what a property says, by its index, may be wrong for good."""
        state = self.properties[index]
        return self.degraded or state.failures > 0 or state.renewed
