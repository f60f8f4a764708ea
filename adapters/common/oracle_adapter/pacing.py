"""Messages that come in bursts, given so that subscribers with short queues get all of them.

ROS 2's clients of actions keep ten messages of feedback, and decisions come in bursts.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Any, Callable, Deque, Optional

AT_ONCE = 8
"""Messages, or calls, that are given without a pause."""
PAUSE = 0.001
"""Seconds between so many and the next."""


class Pacer:
    """Gives messages in order, at most `AT_ONCE` within `PAUSE` seconds.

    Those that wait are given by a thread, which ends with the last of them.
    """

    def __init__(
        self, give: Callable[[Any], object], clock: Callable[[], float] = time.monotonic
    ) -> None:
        """`give` must not raise; it is never called by two threads at a time. `clock`: seconds."""
        self._give, self._clock = give, clock
        self._lock = threading.Lock()  # guards what follows, and is held while something is given
        self._waiting: Deque[Any] = deque()
        self._given, self._since = 0, clock()
        self._thread: Optional[threading.Thread] = None
        self._stopped = False

    def take(self, message: Any) -> bool:
        """Give a message at once, or in its turn; False after `stop`."""
        with self._lock:
            if self._stopped:
                return False
            if self._thread is None and self._has_turn():
                self._give(message)
                return True
            self._waiting.append(message)
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name="pacer", daemon=True)
                self._thread.start()
            return True

    def stop(self) -> None:
        """Give what waits now, without pauses, and nothing more."""
        with self._lock:
            self._stopped = True
            while self._waiting:
                self._give(self._waiting.popleft())

    def _has_turn(self) -> bool:
        now = self._clock()
        if now - self._since >= PAUSE:
            self._given, self._since = 0, now
        self._given += 1
        return self._given <= AT_ONCE

    def _work(self) -> None:
        while True:
            time.sleep(PAUSE)
            with self._lock:
                for _ in range(min(AT_ONCE, len(self._waiting))):
                    self._give(self._waiting.popleft())
                if not self._waiting:
                    self._thread, self._given, self._since = None, AT_ONCE, self._clock()
                    return
