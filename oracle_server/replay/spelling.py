"""Texts that a spec asks for and a recording never has, but has otherwise spelt: `Auto` where it is `AUTO`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set

from oracle_server.core.events import StreamKey
from oracle_server.core.formula.tree import Atom, Scalar
from oracle_server.core.kinds import NAMING
from oracle_server.core.spec import Spec
from oracle_server.replay.coverage import signal_names

_SPACES = str.maketrans("- ", "__")


class Spelling:
    """Notes the values of signals that are like a text with which the spec compares them."""

    def __init__(self, spec: Spec) -> None:
        """Begin with nothing seen."""
        self._asked = [
            (reader, name, text)
            for reader, atoms in _readers(spec)
            for name, text in dict.fromkeys(pair for atom in atoms for pair in _texts(atom))
        ]
        wanted: dict[str, dict[str, set[str]]] = {}
        for _, name, text in self._asked:
            wanted.setdefault(name, {}).setdefault(_plain(text), set())
        self._seen: Mapping[str, Mapping[str, set[str]]] = wanted
        """By signal and plain spelling, how its values were spelt."""
        self._names = {key: [n for n in signal_names(spec, key) if n in wanted] for key in spec.by_key}

    def look(self, stream: StreamKey, signals: Mapping[str, Scalar]) -> None:
        """Look at what an event of a stream had itself."""
        for name in self._names.get(stream, ()):
            value = signals.get(name)
            if isinstance(value, str):
                seen = self._seen[name].get(_plain(value))
                if seen is not None:
                    seen.add(value)

    def doubts(self) -> Iterator[str]:
        """What is to be said, a line each."""
        asked = set(self._asked)
        for reader, name, text in self._asked:
            seen: Set[str] = self._seen[name][_plain(text)]
            if seen and not any((reader, name, value) in asked for value in seen):
                had = " or ".join(f'"{value}"' for value in sorted(seen)[:3])
                yield f'{reader} compares {name} with "{text}", which it never was: it was {had}'


def _readers(spec: Spec) -> Iterator[tuple[str, tuple[Atom, ...]]]:
    """The properties and derived signals, by name, each with the atoms that it reads."""
    yield from ((prop.id, prop.atoms) for prop in spec.properties if not prop.external)
    yield from ((definition.name, definition.tested) for definition in spec.derive)


def _texts(atom: Atom) -> Iterator[tuple[str, str]]:
    """The signals of an atom that are compared with texts, with these."""
    for constraint in atom.constraints:
        if isinstance(constraint.value, str) and constraint.key not in NAMING:
            yield constraint.key, constraint.value


def _plain(text: str) -> str:
    """A text without what is easily written otherwise: capitals, white space and slashes around it, `-` and spaces."""
    return text.strip().strip("/").casefold().translate(_SPACES)
