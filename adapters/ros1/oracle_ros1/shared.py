"""What the parts of one monitor share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional

from oracle_adapter import Board, Link, Names
from oracle_adapter.clocks import Clocks

from oracle_ros1.graph import Graph
from oracle_ros1.stamps import Now


@dataclass(frozen=True)
class Shared:
    """The link and the board that all report to, and what all look up."""

    link: Link
    board: Board
    names: Names
    now: Now
    graph: Graph
    clocks: Clocks
    frame: Optional[int] = None
    """How large an event may be (bytes); None where nothing limits it, as in a log."""
