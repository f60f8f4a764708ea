"""Python's garbage collection, made less frequent, and short however many objects there are."""

from __future__ import annotations

import gc
import time
from collections.abc import Iterator
from contextlib import contextmanager

_YOUNG = 3_000
"""New objects between two collections of the youngest generation; Python's default of 700 is one or two events."""
_OLDER = 2, 1
"""Collections of one generation before one of the next: a full one looks through some 20,000 new objects."""
_LOOK_EACH = 50
"""Full collections between two counts of all objects, which take a tenth of the time that collecting them would."""
_MANY = 1_000_000
"""Objects beyond which all are looked through once: by then there may be cycles among those that had lived for long."""


@contextmanager
def uncollected() -> Iterator[None]:
    """Collect nothing within this: what makes many objects that stay would have all of them looked through often."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


class _Full:
    """What full collections have taken, and what becomes of the objects that they leave."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._begin: float | None = None
        self.freezes = False
        """Whether what a full collection leaves is never looked at again; else each one looks at all there is."""
        self._collections, self._most = 0, _MANY
        self._thorough = False

    def __call__(self, phase: str, info: dict[str, int]) -> None:
        """Called by the collector at both ends of each collection."""
        if info["generation"] != 2:
            return
        try:
            self._note(phase)
        except RecursionError:  # it was called deep within what a monitor has sent; the next one is looked at again
            self._begin = None

    def _note(self, phase: str) -> None:
        if phase == "start":
            self._begin = time.thread_time()
            return
        if self.freezes:
            self._freeze()
        if self._begin is not None:
            self.seconds += time.thread_time() - self._begin

    def _freeze(self) -> None:
        gc.freeze()
        self._collections += 1
        if self._thorough:
            self._most = max(_MANY, 2 * gc.get_freeze_count())
            self._thorough = False
        elif self._collections % _LOOK_EACH == 0 and gc.get_freeze_count() > self._most:
            gc.unfreeze()
            self._thorough = True


_full = _Full()
gc.callbacks.append(_full)


def collecting() -> float:
    """The processor's seconds that full collections of garbage have taken, which are nobody's."""
    return _full.seconds


def collect_rarely() -> None:
    """Exclude all present objects from garbage collection, and all that a full one leaves; collect new ones rarely.

    Judging makes hardly any reference cycles, and collections took a tenth of its time. A full one kept all waiting for
    130 ms where 500 sessions were open. So what has lived for long must go without the collector: only once there are
    very many objects are all of them looked through.
    """
    _full.freezes = True
    gc.freeze()
    gc.set_threshold(_YOUNG, *_OLDER)
