"""What ends an evaluation without a value. None of it is an error to a caller: a signal is absent, or has failed."""

from __future__ import annotations

from typing import Any

from oracle_server.core.expression.tree import Node


class Stopped(Exception):  # noqa: N818 -- caught where a signal is computed
    """There is no value; `node` is the part of the expression that has none, where that was asked for."""

    node: Node | None = None


class Absent(Stopped):
    """The value depends on a field that is missing or null."""


class Failed(Stopped):
    """The value can't be computed: `why`, from these operands of the part that failed."""

    def __init__(self, why: str, *operands: Any) -> None:
        super().__init__(why)
        self.why, self.operands = why, operands


class Exhausted(Failed):
    """The value costs more than is allowed."""
