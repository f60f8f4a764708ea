"""Numbers that formulas look for among the rows of a message, as of joints or channels, and that no row ever has."""

from __future__ import annotations

from collections.abc import Iterator

from oracle_server.core.events import Step, StreamKey
from oracle_server.core.formula.tree import Atom
from oracle_server.core.kinds import NAMING
from oracle_server.core.plan import can_meet
from oracle_server.core.spec import Spec
from oracle_server.replay.doubts.rownames import Had, listed
from oracle_server.replay.doubts.spelling import readers

_MOST = 1_000
"""Rows of a message; of one with more nothing is said."""


class _Rows:
    """The numbers that a signal had in the rows of each message."""

    def __init__(self) -> None:
        self.had = Had()
        self._message: tuple[str, int] | None = None
        self._own: list[int] = []

    def add(self, message: tuple[str, int], number: int) -> None:
        """Note what a row of a message had."""
        if message != self._message:
            self.end()
            self._message = message
        if len(self._own) <= _MOST:
            self._own.append(number)

    def end(self) -> None:
        """Note the rows of the message that was the last."""
        if self._own:
            self.had.add(self._own)
        self._own = []


class RowNumbers:
    """Notes the numbers of rows with which a spec compares others, as names are: each message has the same ones."""

    def __init__(self, spec: Spec) -> None:
        """Begin with nothing seen."""
        self._asked = dict.fromkeys(
            (reader, key, name, number)
            for reader, atoms in readers(spec)
            for atom in atoms
            for name, number in _numbers(atom)
            for key, stream in spec.by_key.items()
            if stream.each is not None and name in (stream.signals or ()) and can_meet(stream, _naming(atom))
        )
        self._rows: dict[StreamKey, dict[str, _Rows]] = {}
        for _, key, name, _ in self._asked:
            self._rows.setdefault(key, {}).setdefault(name, _Rows())

    def look(self, step: Step) -> None:
        """Look at what an event had itself."""
        event = step.event
        for name, rows in self._rows.get(event.stream, {}).items() if event.row is not None else ():
            value = step.signals.get(name)
            if isinstance(value, int) and not isinstance(value, bool):
                rows.add((event.monitor, event.seq), value)

    def doubts(self) -> Iterator[tuple[str, str]]:
        """What is to be said: who asks for a number, and a line of it."""
        for reader, key, name, number in self._asked:
            rows = self._rows[key][name]
            rows.end()
            if rows.had.lacks(number) and number not in rows.had.names:
                was = listed(number, rows.had.names)
                yield reader, f"{reader} compares {name} of {key} with {number}, which it never was: it was {was}"


def _numbers(atom: Atom) -> Iterator[tuple[str, int]]:
    """The signals that an atom compares with whole numbers, with these."""
    for constraint in atom.constraints:
        value = constraint.value
        if constraint.op == "==" and isinstance(value, int) and not isinstance(value, bool):
            yield constraint.key, value


def _naming(atom: Atom) -> Atom:
    """What an atom says of whose events it means, and nothing else."""
    return Atom(tuple(c for c in atom.constraints if c.key in NAMING))
