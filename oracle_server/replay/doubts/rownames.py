"""Names that expressions look for among a message's rows, and that no row ever has: hardly those of this robot."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from oracle_server.core.events import StreamKey
from oracle_server.core.expression import Expression, tree
from oracle_server.core.nearest import near
from oracle_server.core.spec import Spec, StreamSpec
from oracle_server.replay.doubts.emptylists import EmptyLists

_Path = tuple[str, ...]
_Name = str | int
_MOST = 1_000
"""Names of rows that are kept: of a list with more nothing is said."""
_SHOWN = 3


class _Rows(NamedTuple):
    """A list within the messages of a stream, and the field of its elements that is compared, none for themselves."""

    stream: StreamKey
    path: _Path
    field: _Path


class Had:
    """What a field of rows was: names, where no two rows of a message had the same, and there were several."""

    def __init__(self) -> None:
        self.names: dict[_Name, None] = {}
        self._several, self._repeated, self._sets = False, False, set[frozenset[_Name]]()

    def add(self, values: Sequence[_Name]) -> None:
        """Note what the rows of a message had."""
        if self._repeated or len(self.names) >= _MOST:
            return
        own = frozenset(values)
        self._repeated = len(own) < len(values)
        self._several = self._several or len(own) > 1
        if len(self._sets) < 2:
            self._sets.add(own)
        self.names.update(dict.fromkeys(values))

    def lacks(self, name: _Name) -> bool:
        """Whether a name is hardly one of these rows: each message has the same ones, or another is spelt like it.

        Where they come and go, as faults that are active do, a sound run need not have each.
        """
        if not self._several or self._repeated or len(self.names) >= _MOST or name == "":
            return False
        return len(self._sets) == 1 or bool(_likely(name, self.names))


class RowNames:
    """Notes the values of the fields of rows that expressions compare with what is written out."""

    def __init__(self, spec: Spec) -> None:
        """Begin with nothing seen; the expressions must be sound."""
        self._asked: dict[tuple[_Rows, str], dict[_Name, None]] = {}
        """By the rows and the signal that compares them what these are compared with."""
        for stream in spec.streams:
            for name, text in (stream.signals or {}).items():
                for rows, wanted in _compared_in(stream, stream.read(text)):
                    self._asked.setdefault((rows, name), {})[wanted] = None
        self.empty = EmptyLists(spec)
        """The lists that had no rows at all."""
        self._had = {rows: Had() for rows, _ in self._asked}
        self._by_stream: dict[StreamKey, list[_Rows]] = {}
        for rows in self._had:
            self._by_stream.setdefault(rows.stream, []).append(rows)

    def look(self, stream: StreamKey, message: object) -> None:
        """Look at a message; one that is not there, as in a session's own trace, tells nothing."""
        self.empty.look(stream, message)
        for rows in self._by_stream.get(stream, ()):
            found = _at(message, rows.path)
            if isinstance(found, list | tuple) and len(found) <= _MOST:
                values = [_at(each, rows.field) for each in found]
                self._had[rows].add([v for v in values if isinstance(v, str | int) and not isinstance(v, bool)])

    def doubts(self) -> Iterator[str]:
        """What is to be said, a line each; nothing where any of what a signal looks for was there."""
        for (rows, signal), wanted in self._asked.items():
            had = self._had[rows]
            for each in wanted if had.names.keys().isdisjoint(wanted) else ():
                if had.lacks(each) and any(type(name) is type(each) for name in had.names):
                    where = ".".join(("msg", *rows.path))
                    field = f"{'.'.join(rows.field)} of {where}" if rows.field else f"the elements of {where}"
                    what = f"compares {field} with {_shown(each)}, which it never was: it was {listed(each, had.names)}"
                    yield f"{rows.stream}: the signal {signal} {what}"


def listed(wanted: _Name, names: Mapping[_Name, None]) -> str:
    """Some names, those that are like the one that is wanted first, and how many more there are."""
    told = list(dict.fromkeys([*_likely(wanted, names), *names]))
    more = [f"{len(told) - _SHOWN} more"] if len(told) > _SHOWN else []
    *first, last = (*map(_shown, told[:_SHOWN]), *more)
    return f"{', '.join(first)} and {last}" if first else last


def _likely(wanted: _Name, names: Mapping[_Name, None]) -> list[str]:
    return near(wanted, [name for name in names if isinstance(name, str)]) if isinstance(wanted, str) else []


def _shown(name: _Name) -> str:
    return json.dumps(name, ensure_ascii=False)


def _compared_in(stream: StreamSpec, expression: Expression) -> Iterator[tuple[_Rows, _Name]]:
    """The rows of messages that an expression compares with names that are written out, with these."""
    lists = {} if stream.each is None else _variable("item", stream.read(stream.each).tree)
    for compare, known in _comparisons(expression.tree, lists):
        for row, other in ((compare.left, compare.right), (compare.right, compare.left)):
            found = _field_of(row, known)
            if compare.mark == "in" and isinstance(compare.right, tree.Path):
                found = (compare.right.names, ()) if row is compare.right else None
            for value in other.items if isinstance(other, tree.ListOf) else (other,):
                name = value.value if isinstance(value, tree.Literal) else None
                if found is not None and isinstance(name, str | int) and not isinstance(name, bool):
                    yield _Rows(stream.key, *found), name


def _comparisons(node: tree.Node, lists: Mapping[str, _Path]) -> Iterator[tuple[tree.Compare, Mapping[str, _Path]]]:
    """The comparisons in an expression, each with the lists that the variables around it go through, by their names."""
    if isinstance(node, tree.Compare) and node.mark in ("==", "!=", "in"):
        yield node, lists
    inner = lists
    if isinstance(node, tree.Loop):  # its variable may be one of another loop, too
        inner = {k: v for k, v in lists.items() if k != node.variable} | _variable(node.variable, node.of)
    for each in tree.children(node):
        yield from _comparisons(each, lists if isinstance(node, tree.Loop) and each is node.of else inner)


def _variable(name: str, of: tree.Node) -> dict[str, _Path]:
    """By the name of a loop's variable the list that it goes through, where that is one of the message."""
    return {name: of.names} if isinstance(of, tree.Path) else {}


def _field_of(node: tree.Node, lists: Mapping[str, _Path]) -> tuple[_Path, _Path] | None:
    """The list and the field of its elements that a part of an expression reads, None where it is no such."""
    names: list[str] = []
    while isinstance(node, tree.Field):
        names.append(node.name)
        node = node.of
    if not isinstance(node, tree.Variable) or node.name not in lists:
        return None
    return lists[node.name], tuple(reversed(names))


def _at(value: object, path: _Path) -> object:
    for name in path:
        value = value.get(name) if isinstance(value, Mapping) else None
    return value
