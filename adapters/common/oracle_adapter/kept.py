"""Messages that were kept for who comes later, as on topics that latch or are `transient_local`."""

from __future__ import annotations

from typing import Callable, Optional

_YEAR = 365 * 86_400 * 10**9
"""No robot runs for so long; what is older is by another clock, as that of a simulation."""


def is_from_before(stamp: int, began: int) -> bool:
    """Whether what has a `stamp` was published before a monitor `began` to hear (ns, by one clock).

    By its stamp it would stand where nobody heard anything else, and all that was to come would be
    missing for as long.
    """
    return began - _YEAR < stamp < began


class Beginning:
    """Since when a monitor hears, by its clock: simulated time is told later, and may go back."""

    def __init__(self, now: Callable[[], Optional[int]]) -> None:
        """`now` is the present time (ns); nothing, or 0, while there is none."""
        self._now, self._began = now, now() or 0

    def is_after(self, stamp: int) -> bool:
        """Whether what has just come with a `stamp` is from before that; as `is_from_before`."""
        now = self._now() or 0
        if not self._began or now < self._began:
            self._began = now
        return is_from_before(stamp, self._began)
