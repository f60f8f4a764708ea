"""What is said of an error that nobody foresaw: a defect, unless packages are there that this one does not go with.

It is needed where nothing else can be imported, and imports only what Python has.
"""

from __future__ import annotations

import os
import re
import traceback
from collections.abc import Iterator
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from itertools import zip_longest
from pathlib import Path

_REQUIREMENT = re.compile(r"([\w.-]+)\s*(?:\[[^\]]*\])?\s*\(?([^();]*)\)?\s*")
"""One without a marker: its name, and the bounds of its version."""
_BOUND = re.compile(r"\s*(>=|<=|==|!=|~=|<|>)\s*(\d+(?:\.\d+)*)\s*")


def unforeseen(error: Exception) -> str:
    """What is told of such an error, in a line."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    what = f"{type(error).__name__}: {error} ({frame.filename}:{frame.lineno})".replace("\n", " ")
    if unmet := next(_unmet("oracle-server"), None):
        return f"{unmet} ({what})"
    return f"a defect of oracle-server, please report it: {what}; with PYTHONDEVMODE=1 its whole traceback is shown"


def is_met(version: str, bounds: str) -> bool:
    """Whether a version is within bounds as `>=1.2,<2`; it is where these can't be read."""
    return all(map(_Release(version).is_within, bounds.split(",")))


class _Release:
    """The numbers that a version begins with, as those of `1.10.0rc1`."""

    def __init__(self, version: str) -> None:
        found = re.match(r"\d+(?:\.\d+)*", version)
        self._numbers = _numbers(found[0]) if found else None

    def is_within(self, bound: str) -> bool:
        read = _BOUND.fullmatch(bound)
        if self._numbers is None or read is None:
            return True
        numbers = _numbers(read[2])
        pairs = list(zip_longest(self._numbers, numbers, fillvalue=0))
        mine, other = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
        return {
            ">=": mine >= other,
            "<=": mine <= other,
            ">": mine > other,
            "<": mine < other,
            "==": mine == other,
            "!=": mine != other,
            "~=": mine >= other and mine[: len(numbers) - 1] == numbers[:-1],
        }[read[1]]


def _numbers(version: str) -> list[int]:
    return [int(part) for part in version.split(".")]


def _unmet(package: str) -> Iterator[str]:
    """What a package needs, and what that needs in turn, and is not there as it is needed."""
    seen, left = {package}, [package]
    while left:
        user = left.pop(0)
        for name, bounds in _needs(user):
            try:
                found = distribution(name)
            except PackageNotFoundError:
                yield f"{user} needs {name}{bounds}, which is not installed: {_own_place()}"
                continue
            if not is_met(found.version, bounds):
                yield f"{user} needs {name}{bounds}, and {_found(found, name)}"
            if name not in seen:
                seen.add(name)
                left.append(name)


def _needs(package: str) -> Iterator[tuple[str, str]]:
    """The names and bounds of what a package needs everywhere."""
    try:
        requirements = distribution(package).requires or []
    except PackageNotFoundError:
        return
    for requirement in requirements:
        if read := _REQUIREMENT.fullmatch(requirement):
            yield read[1], read[2].strip()


def _found(there: Distribution, name: str) -> str:
    folder = Path(str(there.locate_file("")))
    paths = [Path(path).resolve() for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path]
    todo = f"take {folder} out of PYTHONPATH" if folder.resolve() in paths else _own_place()
    return f"finds {name} {there.version} in {folder}: {todo}"


def _own_place() -> str:
    return "install oracle-server, with all that it needs, into an environment of its own, as pipx or uv make one"
