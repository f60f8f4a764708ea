"""Machines told apart by the values of several signals, of which an event need not have all."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any, Final

from oracle_server.core.derived.definition import MAX_PARAMETRIC, Definition
from oracle_server.core.derived.keyed import key_of, texts_of, value_of
from oracle_server.core.derived.machine import Machines, Standing
from oracle_server.core.derived.queue import Key
from oracle_server.core.derived.samples import FAILED, Value
from oracle_server.core.derived.window import Session
from oracle_server.core.events import Signals
from oracle_server.core.formula.tree import Scalar

_ANY: Final = ...
"""Stands for any key of a value that a step does not have."""
Parts = tuple[Any, ...]
"""The keys of a step's values, in the order of the signals; `_ANY` where it has none."""


class _Agreeing:
    """Keys of several values, found by some of these."""

    def __init__(self, size: int) -> None:
        self._found: list[dict[Any, dict[Key, None]]] = [{} for _ in range(size)]

    def add(self, key: Any) -> None:
        """Add a key, which may be there already."""
        for found, part in zip(self._found, key, strict=True):
            found.setdefault(part, {})[key] = None

    def discard(self, key: Any) -> None:
        """Take a key out that is there."""
        for found, part in zip(self._found, key, strict=True):
            del found[part][key]
            if not found[part]:
                del found[part]

    def of(self, parts: Parts) -> list[Key]:
        """The keys that agree with what is there of some values, of which one is at least."""
        given = [(place, part) for place, part in enumerate(parts) if part is not _ANY]
        least = min((self._found[place].get(part, {}) for place, part in given), key=len)
        return [key for key in least if all(key[place] == part for place, part in given)]  # type: ignore[index] # tuples


class Parametric(Machines):
    """Such machines: an event with all values makes one where there is none, and with some it is of all that agree.

    At a step with some of the values the signal is what all of these are; where they differ it is the error, if one of
    them is in it, else absent.
    """

    def __init__(self, definition: Definition, session: Session) -> None:
        super().__init__(definition, session)
        self.by = definition.by
        self._agreeing = _Agreeing(len(self.by))

    def take(self, sample: Value, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """Take the events of a step, as bits; returns what the signal is with them."""
        self._let_go_of_marks(now)
        if any(name in failed for name in self.by):
            return self._lose_all(now)
        parts = self._parts(signals)
        if _ANY not in parts:
            had = self._standings.get(parts)
            if had is None and len(self._standings) >= self._look_at and not self._has_room(now):
                self._change("_crowded", now)
                return FAILED
            self._move(parts, had, sample, now, number)
        elif any(part is not _ANY for part in parts):
            for key, standing in self._among(parts, now):
                self._move(key, standing, sample, now, number)
        return self._value_of(parts, now)

    def shown(self, now: int, signals: Signals) -> tuple[tuple[Scalar, ...], Standing] | None:
        """A machine that makes the signal of a step or tick what it is at a time (ns), and how that one stands."""
        parts = self._parts(signals)
        if _ANY not in parts:
            return tuple(signals[name] for name in self.by), self._known(self._standings.get(parts), now)
        found = sorted(self._among(parts, now), key=lambda each: (each[1].since, texts_of(each[0])))
        wrong = [each for each in found if self._value(each[1].state) == self.table.bad]
        unsure = [each for each in found if self._value(each[1].state) is FAILED]
        chosen = next(iter((*wrong, *unsure, *found)), None)
        if chosen is None or (chosen not in wrong and self._unseen(now) is self._unknown):
            return None
        key, standing = chosen
        return tuple(self._written(key)), standing

    @property
    def most(self) -> int:
        """The most machines that are kept: one event may be of all of them."""
        return MAX_PARAMETRIC

    def _value_at(self, now: int, signals: Signals, failed: Collection[str]) -> Value | None:
        if any(name in failed for name in self.by):
            return FAILED
        return self._value_of(self._parts(signals), now)

    def _value_of(self, parts: Parts, now: int) -> Value | None:
        """What the signal is at a step with such values."""
        if _ANY not in parts:
            return self._value(self._known(self._standings.get(parts), now).state)
        found = {self._value(standing.state) for _, standing in self._among(parts, now)}
        if self.table.bad in found:
            return self.table.bad
        if FAILED in found or (any(part is not _ANY for part in parts) and self._unseen(now) is self._unknown):
            return FAILED
        return found.pop() if len(found) == 1 else None

    def _among(self, parts: Parts, now: int) -> list[tuple[Key, Standing]]:
        """The machines that agree with some values, as they stand; none where there is no value."""
        keys: Sequence[Key] = self._agreeing.of(parts) if any(part is not _ANY for part in parts) else ()
        found = [(key, self._standings[key]) for key in keys]
        return found if self._life is None else [each for each in found if each[1].at + self._life > now]

    def _parts(self, signals: Signals) -> Parts:
        return tuple([_ANY if (value := signals.get(name)) is None else key_of(value) for name in self.by])

    def _put(self, key: Key, standing: Standing | None) -> None:
        super()._put(key, standing)
        if standing is None:
            self._agreeing.discard(key)
        else:
            self._agreeing.add(key)

    def _lose_all(self, now: int) -> Value:
        self._change("_agreeing", _Agreeing(len(self.by)))
        return super()._lose_all(now)

    def _written(self, key: Key) -> Any:
        assert isinstance(key, tuple)  # noqa: S101 -- one of several values
        return [value_of(part) for part in key]

    def _read(self, data: Any) -> Key:
        return tuple([key_of(value) for value in data])  # type: ignore[misc] # each is the key of one value
