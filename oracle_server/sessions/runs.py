"""The names under which a session begins anew: `s1`, `s1.run2`, `s1.run3`; long ones are cut, and have a digest."""

from __future__ import annotations

from collections.abc import Iterable
from hashlib import sha256

_ANEW = ".run"
_LONGEST = 60
"""Characters of a name without what is added to it, together with the number."""
_DIGITS = 9
"""More than the number of any run has."""
_DIGEST = 10
_HEAD = _LONGEST - _DIGITS - _DIGEST - 1
"""Characters that are left of a name which is cut; with its digest it takes any number, and is not cut again."""


def run_of(name: str) -> tuple[str, int]:
    """The name that a session began with, and the number of its run: 1 for one that did not begin anew."""
    stem, mark, number = name.rpartition(_ANEW)
    numbered = mark and number.isascii() and number.isdecimal() and number[0] != "0" and len(number) <= _DIGITS
    return (stem, int(number)) if numbered and int(number) > 1 else (name, 1)


def named(stem: str, run: int) -> str:
    """The name of a run."""
    return stem if run == 1 else f"{_cut(stem, str(run))}{_ANEW}{run}"


def last_run(stem: str, names: Iterable[str]) -> str | None:
    """The name of the last run of a session among some names; None where none of them is one.

    One that an older version has named may be that of several sessions; it is counted where no other one is there.
    """
    known, runs = set(names), beginning(stem)
    likely = [name for name in known if name == stem or name.startswith(runs)]  # few of all that are open
    found = [name for name in likely if name == stem or _is_named(name, stem) or _is_alone(name, stem, known)]
    return max(found, key=lambda name: (run_of(name)[1], _is_named(name, stem)), default=None)


def beginning(stem: str) -> str:
    """What the names of all runs but the first begin with, and as few others as can be."""
    return stem[:_HEAD] if len(stem) > _LONGEST - _DIGITS else stem + _ANEW


def goes_on(name: str, session: str) -> bool:
    """Whether a name is one under which the server lets a session go on, or an older version did."""
    return _is_named(name, session) or _was_named(name, session)


def _is_named(name: str, session: str) -> bool:
    stem, run = run_of(name)
    return run > 1 and stem == _cut(session, str(run))


def _was_named(name: str, session: str) -> bool:
    """Whether an older version has named a run so: sessions whose names begin alike had the same names for these."""
    stem, run = run_of(name)
    return run > 1 and stem == session[: _LONGEST - len(str(run))]


def _is_alone(name: str, session: str, known: set[str]) -> bool:
    """Whether an older version has named a run of this session so, and it can't be that of another one."""
    if not _was_named(name, session):
        return False
    return not any(goes_on(name, other) for other in known if other != session and run_of(other)[1] == 1)


def _cut(stem: str, number: str) -> str:
    """A name to which a number can be added; where it is too long, what is left out of it is told by its digest."""
    if len(stem) <= _LONGEST - len(number):
        return stem
    return f"{stem[:_HEAD]}-{sha256(stem.encode()).hexdigest()[:_DIGEST]}"
