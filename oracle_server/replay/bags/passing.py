"""Which of the messages that waited for a decision passed: those whose content came out behind the filter."""

from __future__ import annotations

from collections import defaultdict
from hashlib import blake2b

from oracle_server.core.spec import SECOND

_SLACK = SECOND // 10
"""How much earlier than the attempt a recorder may note what passed, in nanoseconds."""
Seen = tuple[int, bytes]
"""When a message was recorded (ns), and a digest of its content."""
_UNKNOWN = b""


class Filter:
    """What one filter was asked, and what it gave; `others` counts what it gave and was not asked."""

    def __init__(self, within: int) -> None:
        """A decision takes up to `within` nanoseconds."""
        self.others = 0
        self._within = within + SECOND
        self._asked: list[Seen] = []
        self._given: list[Seen] = []
        self._passed: frozenset[int] | None = None
        self._taken = 0

    def asked(self, time: int, content: bytes | None) -> None:
        """Note an attempt; its content is None where it is not known. Attempts come by time."""
        self._asked.append((time, _digest(content)))

    def gave(self, time: int, content: bytes | None) -> None:
        """Note what passed, by time; its content is None where it is not known."""
        self._given.append((time, _digest(content)))

    def settle(self) -> None:
        """Match what passed with the attempts: the latest one before it with the same content, each once at most."""
        if _UNKNOWN in {digest for _, digest in (*self._asked, *self._given)}:
            return
        asked: defaultdict[bytes, list[tuple[int, int]]] = defaultdict(list)
        for number, (time, digest) in enumerate(self._asked):
            asked[digest].append((time, number))
        gave: defaultdict[bytes, list[int]] = defaultdict(list)
        for time, digest in self._given:
            gave[digest].append(time)
        passed: set[int] = set()
        for digest, times in gave.items():
            passed |= _matched(asked.get(digest, []), times, self._within)
        self._passed = frozenset(passed)
        self.others = len(self._given) - len(passed)

    def take(self) -> bool | None:
        """Whether the next attempt passed, None where that is not known."""
        number = self._taken
        self._taken += 1
        return None if self._passed is None else number in self._passed


def _digest(content: bytes | None) -> bytes:
    return _UNKNOWN if content is None else blake2b(content, digest_size=16).digest()


def _matched(asked: list[tuple[int, int]], times: list[int], within: int) -> set[int]:
    found: set[int] = set()
    open_: list[tuple[int, int]] = []
    coming = 0
    for time in times:
        while coming < len(asked) and asked[coming][0] <= time:
            open_.append(asked[coming])
            coming += 1
        if open_ and time - open_[-1][0] <= within:
            found.add(open_.pop()[1])
        elif coming < len(asked) and asked[coming][0] - time <= _SLACK:
            found.add(asked[coming][1])
            coming += 1
    return found
