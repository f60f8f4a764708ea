"""Texts that a spec asks for and a recording never has, though it has others: hardly the words of this robot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from oracle_server.core.atoms import shortened
from oracle_server.core.events import Event, Step, StreamKey
from oracle_server.core.formula.tree import Atom, Scalar
from oracle_server.core.judging.asked import Idle
from oracle_server.core.nearest import near
from oracle_server.core.ranges import range_of
from oracle_server.core.spec import Spec
from oracle_server.core.typed import StreamTypes
from oracle_server.replay.doubts.asked import own
from oracle_server.replay.doubts.coverage import signal_names
from oracle_server.replay.doubts.rownumbers import RowNumbers
from oracle_server.replay.doubts.spelling import Wanted, plain, readers, sources_of, texts_in

_MOST = 1_000
"""Texts of a signal that are kept: of one with more, as a log's lines, nothing is said."""
_SHOWN = 3


@dataclass(slots=True)
class _Had:
    """The texts that a signal had, and whether no two rows of a message had the same: then they are names of rows."""

    texts: dict[str, None] = field(default_factory=dict)
    several: bool = False
    repeated: bool = False
    _message: tuple[str, int] = ("", 0)
    _rows: dict[str, int | None] = field(default_factory=dict)

    def add(self, text: str, event: Event) -> None:
        """Note what a step had."""
        if text not in self.texts and len(self.texts) < _MOST:
            self.texts[text] = None
        if event.row is None or self.repeated:
            return
        if self._message != (event.monitor, event.seq):
            self._message, self._rows = (event.monitor, event.seq), {}
        self.repeated = self._rows.setdefault(text, event.row) != event.row
        self.several = self.several or len(self._rows) > 1

    @property
    def names_rows(self) -> bool:
        """Whether each row of a message is told apart by it."""
        return self.several and not self.repeated


class Vocabulary:
    """Notes the texts of signals that a spec compares with texts of which nothing tells that there is such a value."""

    def __init__(self, spec: Spec, types: StreamTypes) -> None:
        """Begin with nothing seen; the expressions must be sound."""
        names = {key: signal_names(spec, key) for key in spec.by_key}
        self._wanted: dict[Wanted, list[StreamKey]] = {}
        """What is asked for, with the streams whose values may be meant."""
        self._beside: set[Wanted] = set()
        """Those that say of which events something else is asked, in the same atom."""
        for reader, atoms in readers(spec):
            for atom in atoms:
                for each in (Wanted(reader, *found) for found in texts_in([atom])):
                    self._wanted[each] = sources_of(spec, names, each)
                    self._beside |= {each} if len(own(atom)) > 1 else set()
        self._written = {
            each for each, keys in self._wanted.items() if any(_writes(spec, types, key, each) for key in keys)
        }
        """Those that an expression of the spec can give: they are right, whether they come or not."""
        self._had = {(key, each.name): _Had() for each, keys in self._wanted.items() for key in keys}
        self._numbers = RowNumbers(spec)
        self._names: dict[StreamKey, list[str]] = {}
        for key, name in self._had:
            self._names.setdefault(key, []).append(name)

    def look(self, step: Step) -> None:
        """Look at what an event of a stream had itself."""
        event = step.event
        self._numbers.look(step)
        for name in self._names.get(event.stream, ()):
            value = step.signals.get(name)
            if isinstance(value, str):
                self._had[event.stream, name].add(_short(value), event)

    def doubts(self, idle: Sequence[Idle]) -> Iterator[tuple[str, str]]:
        """What is to be said where nothing was asked of these properties: who asks for a text, and a line of it."""
        yield from self._numbers.doubts()
        waiting = {each.property.id: {*_asks(each.atoms)} for each in idle}
        for each, keys in self._wanted.items():
            had = [self._had[key, each.name] for key in keys]
            texts = [text for one in had for text in one.texts if text.strip()]  # an empty one is no word
            if not texts or len(texts) >= _MOST or each in self._written or self._came(each):
                continue
            in_vain = (each.name, each.text) in waiting.get(each.reader, ())
            names_rows = all(one.names_rows for one in had if one.texts)
            if (names_rows and (in_vain or each in self._beside)) or (in_vain and not self._knows(each.name, keys)):
                why = f"; nothing was asked of {each.reader}" if in_vain else ""
                yield each.reader, f"{_told(each, keys, texts)}{why}"

    def _came(self, wanted: Wanted) -> bool:
        """Whether a text came, or is otherwise spelt, which is said by itself."""
        spelt = plain(wanted.text)
        return any(plain(text) == spelt for key in self._wanted[wanted] for text in self._had[key, wanted.name].texts)

    def _knows(self, name: str, keys: Sequence[StreamKey]) -> bool:
        """Whether any of the texts came with which the spec compares a signal: the others may well be right, too."""
        wanted = {each.text for each, of in self._wanted.items() if each.name == name and not set(of).isdisjoint(keys)}
        return any(text in wanted for key in keys for text in self._had[key, name].texts)


def _asks(atoms: Sequence[Atom]) -> Iterator[tuple[str, Scalar]]:
    return ((name, text) for name, text, _ in texts_in(atoms))


def _short(text: str) -> str:
    return str(shortened(text))


def _writes(spec: Spec, types: StreamTypes, key: StreamKey, wanted: Wanted) -> bool:
    """Whether a stream's signal is computed by an expression that has a text written out as one of its values."""
    stream = spec.by_key[key]
    if stream.signals is None or wanted.name not in stream.signals:
        return False
    shape = types[key].widest if key in types else None
    return wanted.text in range_of(stream.signals[wanted.name], shape, stream.each).values


def _told(wanted: Wanted, keys: Sequence[StreamKey], texts: Sequence[str]) -> str:
    where = " and ".join(map(str, keys))
    told = list(dict.fromkeys([*near(wanted.text, texts), *texts]))
    shown = [f'"{text}"' for text in told[:_SHOWN]]
    more = [f"{len(told) - _SHOWN} more"] if len(told) > _SHOWN else []
    *first, last = (*shown, *more)
    had = f"{', '.join(first)} and {last}" if first else last
    return f'{wanted.reader} compares {wanted.name} of {where} with "{wanted.text}", which it never was: it was {had}'
