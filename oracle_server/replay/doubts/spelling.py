"""Texts that a spec asks for and a recording never has, but has otherwise spelt: `Auto` where it is `AUTO`."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from typing import NamedTuple

from oracle_server.core.events import StreamKey
from oracle_server.core.expression import Expression, tree
from oracle_server.core.expression.static import NOT_FINITE
from oracle_server.core.formula.tree import Atom, Constraint, Scalar
from oracle_server.core.kinds import NAMING
from oracle_server.core.plan import can_meet
from oracle_server.core.ranges import ValueKind
from oracle_server.core.spec import Spec
from oracle_server.replay.doubts.coverage import kind_of, signal_names

_Path = tuple[str, ...]
_SPACES = str.maketrans("- ", "__")


class Wanted(NamedTuple):
    """That a property or derived signal compares a signal with a text, at the events that its atom may meet."""

    reader: str
    name: str
    text: str
    at: Atom


class Spelling:
    """Notes the values of signals that are like a text with which the spec compares them."""

    def __init__(self, spec: Spec) -> None:
        """Begin with nothing seen."""
        self._signals = names = {key: signal_names(spec, key) for key in spec.by_key}
        asked = dict.fromkeys(Wanted(reader, *each) for reader, atoms in readers(spec) for each in texts_in(atoms))
        self._asked = {each: sources_of(spec, names, each) for each in asked}
        """By what is asked the streams whose values may be meant."""
        self._seen: dict[tuple[StreamKey, str], dict[str, set[str]]] = {}
        """By stream, signal and plain spelling, how its values were spelt."""
        for each, sources in self._asked.items():
            for key in sources:
                self._seen.setdefault((key, each.name), {}).setdefault(plain(each.text), set())
        self._names = {key: [n for n in own if (key, n) in self._seen] for key, own in names.items()}

    def look(self, stream: StreamKey, signals: Mapping[str, Scalar]) -> None:
        """Look at what an event of a stream had itself."""
        for name in self._names.get(stream, ()):
            value = signals.get(name)
            if isinstance(value, str):
                seen = self._seen[stream, name].get(plain(value))
                if seen is not None:
                    seen.add(value)

    def doubts(self) -> Iterator[str]:
        """What is to be said, a line each."""
        told = dict.fromkeys(
            f'{each.reader} compares {each.name}{self._of(each)} with "{each.text}", which it never was: it was {had}'
            for each in self._asked
            if (had := " or ".join(f'"{value}"' for value in sorted(self._otherwise(each))[:3]))
        )
        yield from told

    def _otherwise(self, asked: Wanted) -> Set[str]:
        """How a text was spelt, none where it was as its reader asks, there or by another atom."""
        spelt = plain(asked.text)
        ways = {(key, value) for key in self._asked[asked] for value in self._seen[key, asked.name][spelt]}
        if not ways:
            return set()
        by_reader = [each for each in self._asked if (each.reader, each.name) == (asked.reader, asked.name)]
        wanted = {(key, each.text) for each in by_reader for key in self._asked[each]}
        return set() if ways & wanted else {value for _, value in ways}

    def _of(self, asked: Wanted) -> str:
        """Whose signal it is, where others have one of its name."""
        sources = self._asked[asked]
        others = any(asked.name in own and key not in sources for key, own in self._signals.items())
        return f" of {' and '.join(map(str, sources))}" if others else ""


class FieldSpelling:
    """The same of the fields of messages that expressions compare with values, as in `msg.data == 'AUTO'`."""

    def __init__(self, spec: Spec) -> None:
        """Begin with nothing seen; the expressions must be sound."""
        self._asked: dict[tuple[StreamKey, _Path], list[tuple[Scalar, str]]] = {}
        """By stream and field the values that it is compared with, each with the signal that does."""
        for stream in spec.streams:
            for name, text in (stream.signals or {}).items():
                for path, wanted in _compared_in(stream.read(text)):
                    self._asked.setdefault((stream.key, path), []).append((wanted, name))
        self._paths: dict[StreamKey, list[_Path]] = {}
        for key, path in self._asked:
            self._paths.setdefault(key, []).append(path)
        self._texts: dict[tuple[StreamKey, _Path], set[str]] = {key: set() for key in self._asked}
        self._kinds: dict[tuple[StreamKey, _Path], set[ValueKind]] = {key: set() for key in self._asked}
        """What was seen: texts that are like those that are asked for, and of which kinds all values were."""

    def look(self, stream: StreamKey, message: object) -> None:
        """Look at a message; one that is not there, as in a session's own trace, tells nothing."""
        for path in self._paths.get(stream, ()):
            value = message
            for name in path:
                value = value.get(name) if isinstance(value, Mapping) else None
            kind = "number" if isinstance(value, str) and value in NOT_FINITE else kind_of(value)
            if kind is not None:
                self._kinds[stream, path].add(kind)
            if isinstance(value, str) and any(_alike(value, wanted) for wanted, _ in self._asked[stream, path]):
                self._texts[stream, path].add(value)

    def doubts(self) -> Iterator[str]:
        """What is to be said, a line each."""
        for (stream, path), asked in self._asked.items():
            seen, kinds, field = self._texts[stream, path], self._kinds[stream, path], ".".join(("msg", *path))
            if kinds and kinds.isdisjoint(kind_of(wanted) for wanted, _ in asked):
                was, (wanted, name) = " or a ".join(sorted(kinds)), asked[0]
                what = f"with {json.dumps(wanted, ensure_ascii=False)}, and it was always a {was}"
                yield f"{stream}: the signal {name} compares {field} {what}"
            elif not seen.intersection(wanted for wanted, _ in asked if isinstance(wanted, str)):
                for wanted, name in asked:
                    had = " or ".join(f'"{value}"' for value in sorted(seen)[:3] if _alike(value, wanted))
                    what = f'compares {field} with "{wanted}", which it never was: it was {had}'
                    yield from [f"{stream}: the signal {name} {what}"] if had else []


def _compared_in(expression: Expression) -> Iterator[tuple[_Path, Scalar]]:
    """The fields of the message that an expression compares with values that are written out, with these."""
    for node in tree.walk(expression.tree):
        if not isinstance(node, tree.Compare) or node.mark not in ("==", "!=", "in"):
            continue
        for field, other in ((node.left, node.right), (node.right, node.left)):
            values = other.items if isinstance(other, tree.ListOf) else (other,)
            for each in values if isinstance(field, tree.Path) else ():
                literal = each.value if isinstance(each, tree.Literal) else None
                if isinstance(field, tree.Path) and literal is not None and literal not in NOT_FINITE:
                    yield field.names, literal


def _alike(value: str, wanted: Scalar) -> bool:
    return isinstance(wanted, str) and plain(value) == plain(wanted)


def sources_of(spec: Spec, names: Mapping[StreamKey, Sequence[str]], asked: Wanted) -> list[StreamKey]:
    """The streams that have a signal which an atom reads at their events, or at others' since they hold it."""
    return [
        key
        for key, own in names.items()
        if asked.name in own and (can_meet(spec.by_key[key], asked.at) or asked.name in spec.by_key[key].hold)
    ]


def readers(spec: Spec) -> Iterator[tuple[str, tuple[Atom, ...]]]:
    """The properties and derived signals, by name, each with the atoms that it reads."""
    yield from ((prop.id, prop.atoms) for prop in spec.properties if not prop.external)
    for each in spec.derive:
        compared = _compared_in(each.expression) if each.op == "expression" else ()
        yield each.name, (*each.tested, *(Atom((Constraint(path[0], "==", text),)) for path, text in compared))


def texts_in(atoms: Iterable[Atom]) -> Iterator[tuple[str, str, Atom]]:
    """The signals that atoms compare with texts, with these, and what else the atoms say of whose events they mean."""
    for atom in atoms:
        for constraint in atom.constraints:
            if isinstance(constraint.value, str) and constraint.key not in NAMING:
                yield constraint.key, constraint.value, Atom(tuple(c for c in atom.constraints if c.key in NAMING))


def plain(text: str) -> str:
    """A text without what is easily written otherwise: capitals, white space and slashes around it, `-` and spaces."""
    return text.strip().strip("/").casefold().translate(_SPACES)
