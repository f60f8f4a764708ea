"""The names of sessions that go on after a restart of their simulation: `s1`, `s1.run2`, `s1.run3`."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

_ANEW = ".run"
_LONGEST = 60
"""Characters of a name without what is added to it, together with the number."""


def successors(name: str) -> Iterator[str]:
    """The names under which a session may go on, in order and without end."""
    stem, mark, number = name.rpartition(_ANEW)
    stem, first = (stem, int(number) + 1) if mark and number.isdecimal() else (name, 2)
    return (f"{_cut(stem, str(n))}{_ANEW}{n}" for n in itertools.count(first))


def goes_on(name: str, session: str) -> bool:
    """Whether a name is one under which the server lets a session go on."""
    stem, mark, number = name.rpartition(_ANEW)
    numbered = mark and number.isascii() and number.isdecimal() and number[0] != "0" and int(number) > 1
    return bool(numbered) and stem == _cut(session, number)


def _cut(stem: str, number: str) -> str:
    return stem[: _LONGEST - len(number)]
