"""Atoms that compare with variables, as `{v > *x}`: they hold for all values that are on the right side of a number."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Sequence
from functools import lru_cache
from typing import Any

from oracle_server.core.atoms import Match, precedes
from oracle_server.engines.native.keys import ALL, Key, Region, Text, Variables, fresh_key, key_of, texts_of
from oracle_server.engines.native.nodes import ABSENT, Absent, Leaf

Limit = tuple[int, str, Text]
"""The place of a variable in a key, how a signal compares with its value, and the signal's value as text."""
_KEPT = 4_096


def is_right(limits: Sequence[Limit], texts: Sequence[Text]) -> bool:
    """Whether signals compare so with the values of variables; what is not known does."""
    return all(value is None or precedes(value_of(value), op, value_of(texts[place])) for place, op, value in limits)


@lru_cache(maxsize=_KEPT)
def value_of(text: Text) -> Any:
    """The value of a canonical text, None for the fresh one."""
    return None if text is None else json.loads(text)


class ComparedNode(Leaf):
    """Such an atom. It is asked about the values that something else has bound, and can't list those it holds for."""

    __slots__ = ("_equal", "_fresh", "_limits", "flat", "variables")

    def __init__(self, variables: Variables, refs: tuple[int, ...], limits: Sequence[tuple[str, int]]) -> None:
        """`refs` are the variables that it binds, in their order, `limits` those that it compares with, and how."""
        self.variables = variables
        self.flat, self.binds = True, frozenset()
        self.changes = []
        self.current = ABSENT
        """The texts that it binds, and behind them those that it compares."""
        self._equal = [variables.index(v) for v in refs]
        self._limits = [(variables.index(v), op) for op, v in limits]
        self._fresh = fresh_key(len(variables))

    def take(self, match: Match) -> None:
        """Move on to the next step."""
        current: Key | Absent = ABSENT if match is None else tuple(match)
        self.changes = [] if current == self.current else [self._fresh]
        self.current = current

    def snapshot(self) -> Any:
        """What it was told, as plain data."""
        return [self.current] if self.holds else []

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        self.current = tuple(data[0]) if data else ABSENT

    def at(self, key: Key) -> bool:
        """Whether it holds at a key."""
        if isinstance(self.current, Absent):
            return False
        texts, current = texts_of(key), self.current
        compared = current[len(self._equal) :]
        limits = [(place, op, value) for (place, op), value in zip(self._limits, compared, strict=True)]
        return all(texts[p] == t for p, t in zip(self._equal, current, strict=False)) and is_right(limits, texts)

    def points(self) -> Collection[Key]:
        """None that could be listed."""
        return ()

    def spread(self, region: Region, place: int) -> Collection[str]:  # noqa: ARG002 -- as at every node
        """None that could be listed."""
        return ()

    def constant(self, region: Region) -> bool | None:
        """False where it holds nowhere."""
        if not self.holds:
            return False
        return None if ALL in region else self.at(key_of(region))

    def index(self) -> None:
        """Nothing to prepare."""

    def apart(self, variable: int) -> Iterator[str]:  # noqa: ARG002
        """None that could be listed."""
        return iter(())

    def settled(self, key: Key) -> None:
        """None: the next step may be any."""

    def can_settle(self, fresh: frozenset[int]) -> tuple[bool, bool]:  # noqa: ARG002
        """Neither."""
        return False, False
