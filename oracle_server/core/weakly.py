"""Methods that a part calls of what it belongs to, without keeping that alive.

What would hold each other is freed by the garbage collector alone, which looks seldom at what has lived for long.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar
from weakref import WeakMethod

P = ParamSpec("P")
T = TypeVar("T")


def weakly(method: Callable[P, T]) -> Callable[P, T]:
    """A bound method as a function that does not keep its object alive, and must not be called after its end."""
    found = WeakMethod(method)

    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        bound = found()
        assert bound is not None  # noqa: S101 -- what calls it belongs to that object
        return bound(*args, **kwargs)

    return call
