"""What a property module makes of the messages of each stream, and how its predicates keep their values."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from oracle_server.specfiles.rosmonitoring.fields import member, there
from oracle_server.specfiles.rosmonitoring.module import PropertyModule
from oracle_server.specfiles.rosmonitoring.state import State
from oracle_server.specfiles.rosmonitoring.streams import Stream
from oracle_server.specfiles.rosmonitoring.values import (
    Const,
    Field,
    Kept,
    Leaf,
    Message,
    Name,
    Predicates,
    Raises,
    Ref,
    Table,
    Term,
    Unread,
    UntranslatableError,
    Value,
    choice,
    each,
    leaves,
)


@dataclass(frozen=True, slots=True)
class Predicate:
    """One predicate: its value by stream, and what it is worth before any message sets it, None where nothing."""

    name: str
    by_stream: Mapping[Stream, Value]
    initial: Value | None

    @property
    def unread(self) -> dict[Stream, str]:
        """The Python that can't be translated, by stream."""
        return {
            stream: leaf.python
            for stream, value in self.by_stream.items()
            for leaf in leaves(value)
            if isinstance(leaf, Unread)
        }

    @property
    def keeping(self) -> Literal["never", "one", "mixed", "always"]:
        """When it keeps its value: at no message, at all of all streams but one, at some of a stream, or for ever."""
        kept = {stream: [isinstance(leaf, Kept) for leaf in leaves(v)] for stream, v in self.by_stream.items()}
        setters = [flags for flags in kept.values() if not all(flags)]
        if not setters:
            return "always"
        if any(any(flags) for flags in setters):
            return "mixed"
        if len(setters) == len(kept):
            return "never"
        return "one" if len(setters) == 1 else "mixed"


def follow(module: PropertyModule, streams: Sequence[Stream], names: Iterable[str]) -> dict[str, Predicate]:
    """What a module makes of some predicates at each of the streams."""
    wanted = sorted(names)
    flags = frozenset(n for n, v in module.initial.items() if isinstance(v, Const) and isinstance(v.value, bool))
    lost = set(module.lost)
    while True:
        before = len(lost)
        found = {stream: _at(module, stream, flags, lost, wanted) for stream in streams}
        others = {n for n in flags for values, _ in found.values() if not _is_flag(values.get(n, Kept(n)))}
        others |= flags - set(wanted)
        if not others & flags and len(lost) == before:
            break
        flags -= others
    initial = module.initial if any(whole for _, whole in found.values()) else {}
    return {n: Predicate(n, {s: values[n] for s, (values, _) in found.items()}, initial.get(n)) for n in wanted}


def _is_flag(value: Value) -> bool:
    return all(
        isinstance(leaf, Kept | Raises)
        or (isinstance(leaf, Const) and isinstance(leaf.value, bool))
        or (isinstance(leaf, Term) and leaf.kind == "bool")
        for leaf in leaves(value)
    )


def _at(
    module: PropertyModule, stream: Stream, flags: frozenset[str], lost: set[Ref], names: Sequence[str]
) -> tuple[dict[str, Value], bool]:
    """The predicates' values at a stream's message, and whether the dictionary `predicates` may be what is returned."""
    try:
        end = module.machine(stream, flags, lost).follow(module.function.body, module.start())
    except (UntranslatableError, RecursionError):
        return {n: Unread(module.python) for n in names}, True
    returned: Value = Raises("nothing is returned") if end.returned is None else end.returned
    whole = any(isinstance(leaf, Predicates) for leaf in leaves(returned))
    mixed = whole and not all(isinstance(leaf, Predicates | Raises) for leaf in leaves(returned))
    found: dict[str, Value] = {}
    for name in names:
        try:
            found[name] = Unread(module.python) if mixed else each(returned, _Key(name, stream, end.state))
        except UntranslatableError:
            found[name] = Unread(module.python)
    return found, whole


@dataclass(frozen=True, slots=True)
class _Key:
    """What reelay reads under a key of a dictionary that was returned."""

    name: str
    stream: Stream
    state: State

    def __call__(self, leaf: Leaf) -> Value:
        match leaf:
            case Predicates():
                return _own(self.state.predicates.get(self.name, Kept(self.name)), self.name)
            case Table(values):
                return _own(dict(values).get(self.name, Kept(self.name)), self.name)
            case Const(dict() as value):
                return Const(value[self.name]) if self.name in value else Kept(self.name)
            case Message():
                return self._of_message()
            case Unread():
                return leaf
            case Const() | Term():
                return Raises("no dictionary is returned")
        raise UntranslatableError

    def _of_message(self) -> Value:
        if self.name == "time" or self.stream.hides(self.name) or Field((self.name,)) in self.state.lost:
            raise UntranslatableError
        if self.name == self.stream.key:
            return Const(Name(self.stream.name))
        if self.stream.kind != "topic" or self.name in ("service", "topic"):
            return Kept(self.name)
        test = there(self.stream.whole, self.name)
        if isinstance(test, Const) and not test.value:
            return Kept(self.name)
        return choice(test, member(self.stream.whole, self.name), Kept(self.name))


def _own(value: Value, name: str) -> Value:
    if any(isinstance(leaf, Kept) and leaf.name != name for leaf in leaves(value)):
        raise UntranslatableError
    return value
