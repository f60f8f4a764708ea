"""A derived signal by the values of another one: a series for each of them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from typing import Any, NamedTuple, cast

import msgspec

from oracle_server.core.atoms import canonical, shortened
from oracle_server.core.derived.age import seconds
from oracle_server.core.derived.definition import MAX_KEYS, Definition
from oracle_server.core.derived.flips import turning_ages
from oracle_server.core.derived.journal import Undo, Was
from oracle_server.core.derived.queue import Key, Queue
from oracle_server.core.derived.samples import FAILED, Value
from oracle_server.core.derived.window import Asked, Series, Session, Window, least
from oracle_server.core.events import Signals
from oracle_server.core.formula.tree import Scalar


def key_of(value: Scalar) -> Key:
    """The key of a value: long texts are shortened."""
    return (value,) if value is True or value is False else shortened(value)


def value_of(key: Key) -> Scalar:
    """The value of the key of one value."""
    return cast("Scalar", key[0]) if isinstance(key, tuple) else key


def texts_of(key: Key) -> tuple[str, ...]:
    """What keys are sorted by: the texts of their values."""
    several = isinstance(key, tuple) and (len(key) > 1 or not isinstance(key[0], bool))
    return tuple(canonical(value_of(part)) for part in (key if several and isinstance(key, tuple) else (key,)))


def names_of(by: Iterable[str]) -> str:
    """The signals by whose values something is kept, in a text."""
    return ", ".join(f"`{name}`" for name in by)


class _Mark(NamedTuple):
    """A sample of a key that is not known: when (ns), and at which step, and which of them is its position."""

    now: int
    number: int
    position: int


class _Entry:
    """The series of a key, the position of its last sample, and the step of the last mark that it has noted."""

    __slots__ = ("newest", "seen", "series")

    def __init__(self, series: Series, newest: int, seen: int) -> None:
        self.series, self.newest, self.seen = series, newest, seen


class _Had(msgspec.Struct, frozen=True, gc=False):
    """Gives a key the entry that it had, None where it had none."""

    entries: dict[Key, _Entry]
    key: Key
    entry: _Entry | None

    def __call__(self) -> None:
        """Take the change back."""
        if self.entry is None:
            del self.entries[self.key]
        else:
            self.entries[self.key] = self.entry


class Keyed:
    """Series by key. Those that are as if they had never had a sample, or are forgotten, are let go."""

    def __init__(self, definition: Definition, make: Callable[[], Series], session: Session) -> None:
        (self._by,) = definition.by
        self._make, self._session = make, session
        self._rate = definition.op == "rate"
        self.last = 0
        clocked = definition.timed or (definition.counted and definition.formula is not None)
        self._life = definition.over if clocked else definition.forget
        """How long a key is kept after its last sample, None for ever."""
        self._by_steps = definition.counted and definition.formula is not None
        self._leaves = definition.timed
        """Whether time alone takes samples away."""
        self._ages = definition.op == "age"
        self._queued = self._life is not None or self._ages
        self._entries: dict[Key, _Entry] = {}
        self._queue = Queue(session.journal)
        self._blind: _Mark | None = None
        """The last sample of which the key is not known: it may be any."""
        self._crowded: _Mark | None = None
        """The last sample of a key for which there was no room."""
        self._empty = make()

    def take(self, sample: Value, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """Add a sample to the series of the step's key; returns what it is for that key."""
        self._let_go(now, number)
        value = signals.get(self._by)
        if value is None:
            if self._by in failed:
                self._change("_blind", self._mark(now, number))
                return FAILED
            return None
        key, position = key_of(value), number if self._by_steps else now
        entry, undone = self._entries.get(key), self._session.journal.entries
        if entry is None:
            if len(self._entries) >= MAX_KEYS:
                self._change("_crowded", self._mark(now, number))
                return FAILED
            entry = self._enter(key, position)
        elif self._blind is not None and entry.seen != self._blind.number:
            self._see(entry)
        value_of_it = entry.series.take(sample, now, number, signals, failed)
        if entry.newest != position:
            if undone is not None:
                undone.append(Was(entry, "newest", entry.newest))
            entry.newest = position
        if self._queued:
            self._queue.add(position, key)
            if self._queue.is_long and not self._queue.trim():
                self._fill()
        return value_of_it

    def value(self, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """What it is for the key of a step; absent where it has none."""
        value = signals.get(self._by)
        if value is None:
            return FAILED if self._by in failed else None
        self._let_go(now, number)
        entry = self._entries.get(key_of(value))
        if entry is None:
            return self._unseen().value(now, number, signals, failed)
        if entry.seen != self._blinds:
            self._see(entry)
        return entry.series.value(now, number, signals, failed)

    def at(self, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """What it is at a tick for the key that this carries, or that is held."""
        value = signals.get(self._by)
        if value is None:
            return FAILED if self._by in failed else None
        position, life = number if self._by_steps else now, self._life
        entry = self._entries.get(key_of(value))
        if entry is not None and (life is None or entry.newest + life > position):
            if entry.seen != self._blinds and self._lasts(self._blind, position):
                return FAILED
            return entry.series.at(now, number, signals, failed)
        marked = self._lasts(self._blind, position) or self._lasts(self._crowded, position)
        return FAILED if marked else self._empty.at(now, number, signals, failed)

    def next_change(self, after: int, asked: Asked) -> int | None:
        """When a sample of some key leaves, or something may be so old that an answer turns."""
        marks = self._marks_after(after)
        if self._ages:
            begun, ages = self._session.begun, self._turning(asked)
            begins = [begun + age for age in ages if begun is not None and begun + age > after]
            spans = ages if self._life is None else (*ages, self._life)
            found = ((self._queue.next_after(after - span), span) for span in spans)
            return least(*begins, *marks, *(at + span for at, span in found if at is not None))
        if not self._leaves or self._life is None:
            return None
        first = self._queue.next_after(after - self._life)
        known = self._session.begun + self._life if self._rate and self._session.begun is not None else after
        left = None if first is None else first + self._life
        return least(left, known if known > after else None, *marks)

    def keys_at(self, time: int, asked: Asked) -> Iterator[Key]:
        """The keys for which an answer may turn at a time."""
        if self._ages:
            ages = self._turning(asked)
            for span in ages if self._life is None else {self._life, *(a for a in ages if a <= self._life)}:
                yield from self._queue.at(time - span)
        elif self._leaves and self._life is not None:
            yield from self._queue.at(time - self._life)
        if self.may_turn_all(time):
            yield from self.known_before(time)

    def may_turn_all(self, time: int) -> bool:
        """Whether an answer may turn at a time for any key, also one that never had a sample."""
        begun, life = self._session.begun, self._life
        begins = self._rate and begun is not None and life is not None and time == begun + life
        return begins or time in self._marks_after(time - 1)

    def known_before(self, time: int) -> list[Key]:
        """The keys that are not forgotten just before a time."""
        return [k for k, entry in self._entries.items() if self._life is None or entry.newest + self._life >= time]

    def settled(self, _now: int, _number: int) -> bool:
        """Whether no key has had a sample."""
        return not self._entries

    def series_of(self, signals: Signals) -> Series | None:
        """The series of a step's key, None where it has none."""
        value = signals.get(self._by)
        entry = None if value is None else self._entries.get(key_of(value))
        return None if entry is None else entry.series

    @property
    def lack(self) -> str:
        """Why it may have failed for some key, empty for no reason of its own."""
        if self._crowded is not None:
            return f"more than {MAX_KEYS:,} values of `{self._by}`"
        return f"`{self._by}` has failed" if self._blind is not None else ""

    def snapshot(self) -> Any:
        """All series as plain data."""
        known = sorted(self._entries.items(), key=lambda entry: canonical(value_of(entry[0])))
        entries = [(value_of(k), e.newest, e.seen, e.series.snapshot()) for k, e in known]
        return [entries, self._blind, self._crowded]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        entries, blind, crowded = data
        for value, newest, seen, saved in entries:
            entry = self._entries[key_of(value)] = _Entry(self._make(), newest, seen)
            entry.series.restore(saved)
        self._blind, self._crowded = (None if mark is None else _Mark(*mark) for mark in (blind, crowded))
        if self._queued:
            self._fill()

    @property
    def _blinds(self) -> int:
        return 0 if self._blind is None else self._blind.number

    def _mark(self, now: int, number: int) -> _Mark:
        return _Mark(now, number, number if self._by_steps else now)

    def _lasts(self, mark: _Mark | None, position: int) -> bool:
        """Whether a mark still counts."""
        return mark is not None and (self._life is None or mark.position + self._life > position)

    def _marks_after(self, after: int) -> list[int]:
        """When samples that were lost count no more, as far as that is later than a time."""
        life = self._life
        marks = () if life is None or self._by_steps else (self._blind, self._crowded)
        return [m.now + life for m in marks if m is not None and life is not None and m.now + life > after]

    def _unseen(self) -> Series:
        """The series of a key that has none: where samples were lost, it may have been one of its own."""
        if self._blind is None and self._crowded is None:
            return self._make()
        marks = [mark for mark in (self._blind, self._crowded) if mark is not None]
        series, mark = self._make(), max(marks)
        series.take(FAILED, mark.now, mark.number, {}, ())
        return series

    def _enter(self, key: Key, position: int) -> _Entry:
        """A new entry for a key."""
        entry = self._entries[key] = _Entry(self._unseen(), position, self._blinds)
        self._note(_Had(self._entries, key, None))
        return entry

    def _see(self, entry: _Entry) -> None:
        """Let a series note the last sample of which the key is not known."""
        if self._blind is not None:
            entry.series.take(FAILED, self._blind.now, self._blind.number, {}, ())
        self._note(Was(entry, "seen", entry.seen))
        entry.seen = self._blinds

    def _let_go(self, now: int, number: int) -> None:
        """Let go of the keys whose last sample is long ago, and of marks."""
        if self._life is None:
            return
        position = number if self._by_steps else now
        limit = position - self._life
        undone = self._session.journal.entries
        for key in self._queue.pass_by(limit):
            entry = self._entries.get(key)
            if entry is not None and entry.newest <= limit:
                if isinstance(entry.series, Window):
                    entry.series.leave()
                if undone is not None:
                    undone.append(_Had(self._entries, key, entry))
                del self._entries[key]
        if self._blind is not None and self._blind.position <= limit:
            self._change("_blind", None)
        if self._crowded is not None and self._crowded.position <= limit:
            self._change("_crowded", None)

    def _fill(self) -> None:
        """Fill the queue with what is still needed of it."""
        found = [(at, key) for key, e in self._entries.items() for at in _places(e, whole=self._leaves)]
        self._queue.fill(sorted(found, key=_position))

    def _turning(self, asked: Asked) -> tuple[int, ...]:
        return turning_ages(tuple(asked), seconds)

    def _change(self, name: str, mark: _Mark | None) -> None:
        self._note(Was(self, name, getattr(self, name)))
        setattr(self, name, mark)

    def _note(self, undo: Undo) -> None:
        if self._session.journal.entries is not None:
            self._session.journal.entries.append(undo)


def _places(entry: _Entry, *, whole: bool) -> Collection[int]:
    """The positions in a queue that an entry needs: of all its samples, or the last one only."""
    series = entry.series
    if not whole or not isinstance(series, Window):
        return (entry.newest,)
    failed = series.failed_at
    of_its_own = () if failed is None or failed > entry.newest else (failed,)
    return {*series.places[series.head :], *of_its_own, entry.newest}


def _position(pair: tuple[int, Key]) -> int:
    return pair[0]
