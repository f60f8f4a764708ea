"""The names under which a session begins anew: `s1`, `s1.run2`, `s1.run3`."""

from __future__ import annotations

from collections.abc import Iterable

_ANEW = ".run"
_LONGEST = 60
"""Characters of a name without what is added to it, together with the number."""
_DIGITS = 9
"""More than the number of any run has."""


def run_of(name: str) -> tuple[str, int]:
    """The name that a session began with, and the number of its run: 1 for one that did not begin anew."""
    stem, mark, number = name.rpartition(_ANEW)
    numbered = mark and number.isascii() and number.isdecimal() and number[0] != "0" and len(number) <= _DIGITS
    return (stem, int(number)) if numbered and int(number) > 1 else (name, 1)


def named(stem: str, run: int) -> str:
    """The name of a run."""
    return stem if run == 1 else f"{_cut(stem, str(run))}{_ANEW}{run}"


def last_run(stem: str, names: Iterable[str]) -> int:
    """The last run of a session among some names; 0 where none of them is one."""
    return max((run_of(name)[1] for name in names if name == stem or goes_on(name, stem)), default=0)


def beginning(stem: str) -> str:
    """What the names of all runs but the first begin with, and as few others as can be."""
    shortest = _cut(stem, "9" * _DIGITS)
    return shortest if len(shortest) < len(stem) else stem + _ANEW


def goes_on(name: str, session: str) -> bool:
    """Whether a name is one under which the server lets a session go on."""
    stem, run = run_of(name)
    return run > 1 and stem == _cut(session, str(run))


def _cut(stem: str, number: str) -> str:
    return stem[: _LONGEST - len(number)]
