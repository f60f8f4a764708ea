"""A YAML document as plain values, with the line and column of each.

It reads mappings without duplicate keys, lists and scalars by the core schema of YAML 1.2. Anchors, aliases and tags
are refused: specs do not need them, and with them a short text can expand to a huge value.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import yaml
from yaml import events

from oracle_server.core.errors import Finding, SpecError
from oracle_server.specfiles.misspelt import Mark, misspelt

MAX_TEXT = 256 * 1024
"""The most characters of a document."""
MAX_DEPTH = 24

KeyPath = tuple[str | int, ...]
"""Keys and indexes that lead to a part of a document."""
Position = tuple[int, int]
"""A line and a column, from 1."""

_QUOTED = {
    '"': re.compile(r"\\x..|\\u.{4}|\\U.{8}|\\.|.", re.DOTALL),
    "'": re.compile(r"''|.", re.DOTALL),
}
"""One character of a quoted text, escaped or not, by the quotes."""
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_ANCHORS = "anchors and aliases are not read; write the value out"
_INTEGER = re.compile(r"[-+]?\d{1,30}")
_FLOAT = re.compile(r"[-+]?(\d+\.\d*|\.\d+|\d+(?=[eE]))([eE][-+]?\d{1,4})?")


@dataclass(slots=True)
class Document:
    """A value, the place of each part of it by path, and the place of each key."""

    file: str
    lines: list[str]
    value: Any = None
    values: dict[KeyPath, events.Event] = field(default_factory=dict)
    keys: dict[KeyPath, Position] = field(default_factory=dict)

    def place(self, path: KeyPath, within: Position | None = None) -> Position:
        """The position of a part, or of a place within its text; of the nearest enclosing part if there is none."""
        while path and path not in self.values:
            path = path[:-1]
        event = self.values.get(path)
        if event is None:
            return (1, 1)
        start = _start(event)
        if within is None or not isinstance(event, events.ScalarEvent):
            return start
        line, column = within
        if event.style == "|":
            return (start[0] + line, column + self._indentation(path, start))
        if _on_one_line(event) and line == 1:
            return (start[0], start[1] + self._raw_length(start, event.style, column - 1))
        return start

    def key_place(self, path: KeyPath) -> Position:
        """The position of a key, or of the value where the path does not end in a key."""
        return self.keys.get(path) or self.place(path)

    def _indentation(self, path: KeyPath, start: Position) -> int:
        """The indentation of a literal block: by its header, else that of its first line."""
        header = re.match(r"\|[+-]?([1-9])", self.lines[start[0] - 1][start[1] - 1 :])
        if header and path in self.keys:
            return self.keys[path][1] - 1 + int(header[1])
        body = next((line for line in self.lines[start[0] :] if line.strip()), "")
        return len(body) - len(body.lstrip(" "))

    def _raw_length(self, start: Position, style: str | None, length: int) -> int:
        """How many characters of the file represent the first `length` ones of a text, including an opening quote."""
        raw = self.lines[start[0] - 1][start[1] - 1 :]
        if style not in _QUOTED:
            return length
        units = _QUOTED[style].finditer(raw, 1)
        return 1 + sum(len(unit[0]) for unit, _ in zip(units, range(length), strict=False))


def read_yaml(text: str, file: str) -> Document:
    """Read a document. Raises `SpecError` with file, line and column."""
    document = Document(file, [*text.splitlines(), ""])  # YAML has more line ends than newlines, as splitlines has
    if len(text) > MAX_TEXT:
        raise _refused(file, None, f"the file has {len(text)} characters; at most {MAX_TEXT} are read")
    try:
        stream = _body(yaml.parse(text, Loader=_Loader))
        document.value = _Builder(document, stream).node((), next(stream, None))
        extra = next(stream, None)
        if extra is not None:
            raise _refused(file, extra.start_mark, "a second document starts here; give each spec a file of its own")
    except yaml.YAMLError as error:
        reason = getattr(error, "problem", None) or getattr(error, "reason", None) or ""
        at = _mark(getattr(error, "problem_mark", None)) or _mark_at(text, getattr(error, "position", None))
        message, place = misspelt(document.lines, reason, at, _mark(getattr(error, "context_mark", None)) or at)
        raise _refused(file, place, f"not YAML: {message}") from None
    return document


def _body(stream: Iterator[events.Event]) -> Iterator[events.Event]:
    frame = events.StreamStartEvent, events.StreamEndEvent, events.DocumentStartEvent, events.DocumentEndEvent
    return (event for event in stream if not isinstance(event, frame))


@dataclass(slots=True)
class _Builder:
    document: Document
    stream: Iterator[events.Event]
    depth: int = 0

    def node(self, path: KeyPath, event: events.Event | None) -> Any:
        if event is None:
            return None
        if isinstance(event, events.AliasEvent) or getattr(event, "anchor", None):
            raise self._refused(
                event,
                f"{_ANCHORS}; put a text that begins with `&` or `*` in quotes",
            )
        tag = getattr(event, "tag", None)
        if tag:
            raise self._refused(event, f"tags such as {tag} are not read; put a text that begins with `!` in quotes")
        self.document.values[path] = event
        if isinstance(event, events.ScalarEvent):
            return _scalar(event)
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise self._refused(event, f"nested more than {MAX_DEPTH} deep")
        value = self._mapping(path) if isinstance(event, events.MappingStartEvent) else self._list(path)
        self.depth -= 1
        return value

    def _mapping(self, path: KeyPath) -> dict[str, Any]:
        value: dict[str, Any] = {}
        while not isinstance(key := next(self.stream), events.MappingEndEvent):
            if not isinstance(key, events.ScalarEvent):
                raise self._refused(key, "a key must be plain text")
            if key.value in value:
                first = self.document.keys[(*path, key.value)][0]
                raise self._refused(
                    key, f"the key '{key.value}' stands here a second time; the first is in line {first}"
                )
            inner = (*path, key.value)
            self.document.keys[inner] = _start(key)
            value[key.value] = self.node(inner, next(self.stream))
        return value

    def _list(self, path: KeyPath) -> list[Any]:
        value: list[Any] = []
        while not isinstance(item := next(self.stream), events.SequenceEndEvent):
            value.append(self.node((*path, len(value)), item))
        return value

    def _refused(self, event: events.Event, message: str) -> SpecError:
        return _refused(self.document.file, event.start_mark, message)


def _scalar(event: events.ScalarEvent) -> str | bool | int | float | None:
    text: str = event.value
    if not event.implicit[0]:
        return text
    if text in ("", "~", "null"):
        return None
    if text in ("true", "false"):
        return text == "true"
    if _INTEGER.fullmatch(text):
        return int(text)
    if _FLOAT.fullmatch(text):
        return float(text)
    return text


def _on_one_line(event: events.Event) -> bool:
    start, end = event.start_mark, event.end_mark
    return start is not None and end is not None and start.line == end.line


def _start(event: events.Event) -> Position:
    mark: Any = event.start_mark
    return (mark.line + 1, mark.column + 1)


def _mark(mark: Any) -> Mark | None:
    return Mark(mark.line, mark.column) if mark else None


def _mark_at(text: str, position: int | None) -> Mark:
    before = text[: position or 0]
    return Mark(before.count("\n"), len(before) - before.rfind("\n") - 1)


def _refused(file: str, mark: Any, message: str) -> SpecError:
    line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
    return SpecError([Finding(file, line, column, message)])
