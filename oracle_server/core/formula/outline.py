"""A formula as the rows of a tree, its parts from left to right under what they are parts of."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import Path, looks_ahead
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.render import head, render
from oracle_server.core.formula.tree import Formula


@dataclass(frozen=True, slots=True)
class Row:
    """A part of a formula.

    `depth` is how many rows it stands under, `head` its operator, or all of an atom or a relation; `text` all of it,
    and `name` that of `define:` which stands for it. `needs` are the variables whose values it depends on; `waits`:
    for what comes. `more`: parts of it are left out.
    """

    part: Formula
    path: Path
    depth: int
    head: str
    text: str
    name: str | None
    needs: tuple[str, ...]
    waits: bool
    more: bool

    @property
    def is_told(self) -> bool:
        """Whether it is true or false at a step by itself: for no value of a variable, and whatever comes."""
        return not self.needs and not self.waits


def outline(formula: Formula, time: Time, most: int) -> list[Row]:
    """The rows of a formula: the upper ones, `most` at the most."""
    under: dict[Path, list[tuple[Path, Formula]]] = {}
    cut: set[Path] = set()
    waiting: deque[tuple[Path, Formula]] = deque([((), formula)])
    room = most - 1
    while waiting:
        path, part = waiting.popleft()
        found = [((*path, *place), child) for place, child in below(part)]
        if len(found) > room:
            cut.add(path)
        under[path] = found[:room]
        room -= len(under[path])
        waiting += under[path]
    return [*_rows(formula, (), 0, time, under, cut)]


def below(part: Formula) -> list[tuple[Path, Formula]]:
    """What is shown under a part, with its place there.

    Nothing of a word, once what has lasted, and all that is joined by one `and` or `or` beside each other.
    """
    if tree.word_of(part) is not None:
        return []
    if tree.lasted(part) is not None:
        return [((1,), tree.children(part)[1])]
    found: list[tuple[Path, Formula]] = []
    for place, child in enumerate(tree.children(part)):
        joined = isinstance(part, tree.And | tree.Or) and type(child) is type(part) and child.written is None
        if joined and tree.word_of(child) is None:
            found += [((place, *path), inner) for path, inner in below(child)]
        else:
            found.append(((place,), child))
    return found


def free(part: Formula) -> frozenset[str]:
    """The variables of a part that quantifiers around it bind."""
    if isinstance(part, tree.Atom | tree.Relation):
        return frozenset(part.variables)
    inner = frozenset[str]().union(*map(free, tree.children(part)))
    return inner - {part.variable} if isinstance(part, tree.Exists | tree.Forall) else inner


def _rows(
    part: Formula,
    path: Path,
    depth: int,
    time: Time,
    under: Mapping[Path, Sequence[tuple[Path, Formula]]],
    cut: Collection[Path],
) -> Iterator[Row]:
    name = None if part.written is None else str(part.written)
    text, needs = render(part, time, named=True), tuple(sorted(free(part)))
    yield Row(part, path, depth, head(part, time), text, name, needs, looks_ahead(part), path in cut)
    for inside, child in under[path]:
        yield from _rows(child, inside, depth + 1, time, under, cut)
