"""How often Python looks for cycles of objects that nobody uses any more."""

from __future__ import annotations

import gc

_YOUNG = 5_000
"""Objects that are made between two looks at the newest ones; Python's own 700 is an event or two."""
_AGAIN = 5, 2
"""Looks at the newest to one at older ones, and of these to one at all: a connection that ended is in a cycle."""


def look_seldom() -> None:
    """Have what is there now never be looked through again, and what is made from now on seldom.

    Judging makes hardly any cycle, and looking for them took a tenth of its time.
    """
    gc.freeze()
    gc.set_threshold(_YOUNG, *_AGAIN)
