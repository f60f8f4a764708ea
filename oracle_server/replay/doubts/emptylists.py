"""Lists that expressions go through, and that were empty in every message of a recording: nothing was looked at."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from oracle_server.core.events import StreamKey
from oracle_server.core.expression import tree
from oracle_server.core.spec import Spec
from oracle_server.core.units import counted

_Path = tuple[str, ...]


class EmptyLists:
    """Watches the lists of messages that expressions go through, until each had an element."""

    def __init__(self, spec: Spec) -> None:
        """Begin with nothing seen; the expressions must be sound."""
        self._open: dict[StreamKey, dict[_Path, int]] = {}
        """By stream the lists that had no element yet, each with how many messages had it."""
        self._readers: dict[tuple[StreamKey, _Path], list[str]] = {}
        for stream in spec.streams:
            for name, text in (stream.signals or {}).items():
                for path in dict.fromkeys(_lists(stream.read(text).tree)):
                    self._open.setdefault(stream.key, {})[path] = 0
                    self._readers.setdefault((stream.key, path), []).append(name)

    def look(self, stream: StreamKey, message: object) -> None:
        """Look at a message; one that is not there, as in a session's own trace, tells nothing."""
        if not (lists := self._open.get(stream)):
            return
        for path in [*lists]:
            found = message
            for name in path:
                found = found.get(name) if isinstance(found, Mapping) else None
            if isinstance(found, list | tuple) and not found:
                lists[path] += 1
            elif found is not None:
                del lists[path]

    def told(self) -> Iterator[str]:
        """What is to be said, a line each."""
        for stream, lists in self._open.items():
            for path, count in lists.items():
                if count:
                    *first, last = self._readers[stream, path]
                    names = f"signals {', '.join(first)} and {last} ask" if first else f"signal {last} asks"
                    where = ".".join(("msg", *path))
                    yield f"{stream}: {where} was empty in {_all(count)}, and of its elements the {names}"


def _all(count: int) -> str:
    return f"all {counted(count, 'message')}" if count > 1 else "its one message"


def _lists(node: tree.Node) -> Iterator[_Path]:
    """The lists of a message whose elements an expression asks for."""
    for each in tree.walk(node):
        if isinstance(each, tree.Loop) and isinstance(each.of, tree.Path):
            yield each.of.names
        elif isinstance(each, tree.Compare) and each.mark == "in" and isinstance(each.right, tree.Path):
            yield each.right.names
