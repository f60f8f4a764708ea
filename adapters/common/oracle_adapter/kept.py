"""Messages that were kept for who comes later, as on topics that latch or are `transient_local`."""

from __future__ import annotations

_YEAR = 365 * 86_400 * 10**9
"""No robot runs for so long; what is older is by another clock, as that of a simulation."""


def is_from_before(stamp: int, began: int) -> bool:
    """Whether what has a `stamp` was published before a monitor `began` to hear (ns, by one clock).

    By its stamp it would stand where nobody heard anything else, and all that was to come would be
    missing for as long.
    """
    return began - _YEAR < stamp < began
