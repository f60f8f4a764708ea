"""Rows that can't be read, as where a disk has failed: it is told which, and nothing else is the worse for it."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

import msgspec

from oracle_server.core.errors import HistoryError, one_line

T = TypeVar("T")
Row = tuple[Any, ...]

DAMAGED = (
    ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError, msgspec.MsgspecError,
)  # fmt: skip
"""What is raised where something is made of values that nobody wrote."""


def readable(called: Callable[[Row], str]) -> Callable[[Callable[[Row], T]], Callable[[Row], T]]:
    """Have what makes something of a row raise `HistoryError` where it can't; the row is `called` so."""

    def decorate(make: Callable[[Row], T]) -> Callable[[Row], T]:
        @wraps(make)
        def made(row: Row) -> T:
            try:
                return make(row)
            except DAMAGED as error:
                raise HistoryError(damaged(error, called(row))) from None

        return made

    return decorate


def damaged(error: Exception, what: str = "a row of it") -> str:
    """What people are told where something of the history can't be made of its row."""
    return f"the history is damaged: {what} can't be read ({one_line(f'{type(error).__name__}: {error}')})"
