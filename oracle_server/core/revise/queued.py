"""What waits to be judged while a pass goes on, beside rows that are judged again; and what is asked of a pass."""

from __future__ import annotations

from typing import NamedTuple

from oracle_server.core.events import Step


class Late(NamedTuple):
    """A late step that is put in its place."""

    step: Step


class Until(NamedTuple):
    """Deadlines up to a time (ns) are to be judged."""

    time: int


class Asked(NamedTuple):
    """The row, by its position, at which the outcome of a property (by its index) is to be explained.

    `tick` is its time (ns) where it is a deadline, else None.
    """

    position: int
    prop: int
    tick: int | None
