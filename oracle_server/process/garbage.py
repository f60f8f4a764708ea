"""Python's garbage collection, made less frequent."""

from __future__ import annotations

import gc
import time
from collections.abc import Iterator
from contextlib import contextmanager

_YOUNG = 5_000
"""New objects between two collections of the youngest generation; Python's default of 700 is one or two events."""
_OLDER = 5, 2
"""Collections of one generation before one of the next; a full one frees connections that have ended."""


@contextmanager
def uncollected() -> Iterator[None]:
    """Collect nothing within this: what makes many objects that stay would have all of them looked through often."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


class _Full:
    """What full collections have taken."""

    def __init__(self) -> None:
        self.seconds = self._begin = 0.0

    def __call__(self, phase: str, info: dict[str, int]) -> None:
        """Called by the collector at both ends of each collection."""
        if info["generation"] == 2:
            if phase == "start":
                self._begin = time.thread_time()
            else:
                self.seconds += time.thread_time() - self._begin


_full = _Full()
gc.callbacks.append(_full)


def collecting() -> float:
    """The processor's seconds that full collections of garbage have taken, which look through all objects."""
    return _full.seconds


def collect_rarely() -> None:
    """Exclude all present objects from garbage collection, and collect new ones rarely.

    Judging makes hardly any reference cycles, and collections took a tenth of its time.
    """
    gc.freeze()
    gc.set_threshold(_YOUNG, *_OLDER)
