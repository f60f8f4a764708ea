"""What the parts of one monitor share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from oracle_adapter import Board, Link, Names
    from oracle_adapter.clocks import Clocks
    from rclpy.node import Node


@dataclass(frozen=True)
class Shared:
    """The node that all belong to, the link and the board that all report to, the streams' names, clocks, limits."""

    node: Node
    link: Link
    board: Board
    names: Names
    clocks: Clocks
    frame: int | None = None
    """How large an event may be (bytes); None where nothing limits it, as in a log."""
