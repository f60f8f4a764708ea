"""Comprehensions: what each makes of the elements of a list, or of the names of a map."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from oracle_server.core.expression.cost import CAUGHT, Frame, charge
from oracle_server.core.expression.stops import Absent, Exhausted, Failed, Stopped
from oracle_server.core.expression.values import unfit

Run = Callable[[Mapping[str, Any], Frame], Any]
"""A message and a frame to a value. Raises `Stopped`."""


def truth(value: Any, why: str) -> bool:
    """A Boolean as it is."""
    if value is True or value is False:
        return value
    raise unfit(why, value)


def loop(kind: str, of: Run, slot: int, body: Run, when: Run | None, steps: int) -> Run:
    """One comprehension, whose element stands at `slot` of the frame, and whose body costs `steps`."""

    def elements(message: Mapping[str, Any], frame: Frame) -> list[Any]:
        found = of(message, frame)
        if type(found) is dict:
            found = list(found)
        elif type(found) is not list:
            raise unfit(f"`{kind}` takes a list", found)
        charge(frame, len(found) * (1 + steps))
        return found

    if kind in ("exists", "all"):
        return _deciding(kind, elements, slot, body)
    if kind == "map":
        return _map(elements, slot, body, when)
    holds = f"`{kind}` takes what is true or false of each element"

    def kept(message: Mapping[str, Any], frame: Frame) -> list[Any]:
        found = []
        for element in elements(message, frame):
            frame[slot] = element
            if truth(body(message, frame), holds):
                found.append(element)
        return found

    return kept if kind == "filter" else lambda message, frame: len(kept(message, frame)) == 1


def _deciding(kind: str, elements: Run, slot: int, body: Run) -> Run:
    """`exists`, which a true element decides, or `all`, which a false one does, whatever the others are."""
    decides = kind == "exists"
    holds = f"`{kind}` takes what is true or false of each element"

    def run(message: Mapping[str, Any], frame: Frame) -> bool:
        stop: Stopped | None = None
        for element in elements(message, frame):
            frame[slot] = element
            try:
                value = truth(body(message, frame), holds)
            except Exhausted:
                raise
            except Stopped as error:
                charge(frame, CAUGHT)
                stop = worse(stop, error)
            else:
                if value is decides:
                    return decides
        if stop is not None:
            raise stop
        return not decides

    return run


def _map(elements: Run, slot: int, body: Run, when: Run | None) -> Run:
    def run(message: Mapping[str, Any], frame: Frame) -> list[Any]:
        found = []
        for element in elements(message, frame):
            frame[slot] = element
            if when is None or truth(when(message, frame), "`map` takes what is true or false first"):
                found.append(body(message, frame))
        return found

    return run


def worse(one: Stopped | None, other: Stopped) -> Stopped:
    """Of two parts without a value, the one that the whole has none for: a failed one before an absent one."""
    if one is None or (isinstance(one, Absent) and isinstance(other, Failed)):
        return other
    return one
