"""Where the values of a message stand while it is serialized, so that lists can be left out that nothing reads.

genpy makes an object of every item of a list, and a number of every cell of a map; to write a map of 16 million cells
as JSON takes seconds, in which no other thread gets the interpreter. Messages are packed: a text is its length and its
bytes, a list its length and its items, and a list of fixed size its items alone.
"""

from __future__ import annotations

import struct
from typing import Any, Callable, Iterable, List, Mapping, Optional, Protocol, Sequence, Tuple

from oracle_adapter.fields import grouped

from oracle_ros1.codec import ARRAY, BYTES, Lookup, sent_name, types_of

WORTH = 256
"""Bytes that a message is to be shorter by for it to be written anew."""
_NUMBER = struct.Struct("<I")
_SIZES = {
    **dict.fromkeys(("bool", "int8", "uint8", "byte", "char"), 1), **dict.fromkeys(("int16", "uint16"), 2),
    **dict.fromkeys(("int32", "uint32", "float32"), 4), **dict.fromkeys(("int64", "uint64", "float64"), 8),
    **dict.fromkeys(("time", "duration"), 8),
}  # fmt: skip

Screen = Callable[[bytes], Tuple[bytes, bool]]


class _Found:
    """What was found in a message."""

    def __init__(self, serialized: bytes) -> None:
        self.serialized = serialized
        self.cuts: List[Tuple[int, int]] = []
        """Where the items of lists begin and end that can be left out."""
        self.is_too_long = False
        """Whether there is a list that is read and that no frame holds."""

    def length(self, at: int) -> int:
        """The length that is written at a place. Raises `struct.error` where the message ends before."""
        return int(_NUMBER.unpack_from(self.serialized, at)[0])


class _Part(Protocol):
    size: Optional[int]
    """How many bytes it always takes; None where that differs."""

    def end(self, found: _Found, at: int) -> int:
        """Where it ends that begins at a place. Raises `struct.error` where the message ends before."""


class _Fixed:
    def __init__(self, size: int) -> None:
        self.size: Optional[int] = size
        self._size = size

    def end(self, _: _Found, at: int) -> int:
        return at + self._size


class _Text:
    size: Optional[int] = None

    def end(self, found: _Found, at: int) -> int:
        return at + _NUMBER.size + found.length(at)


class _Message:
    size: Optional[int] = None

    def __init__(self, parts: Sequence[_Part]) -> None:
        self._parts = parts

    def end(self, found: _Found, at: int) -> int:
        for part in self._parts:
            at = part.end(found, at)
        return at


class _Items:
    """The items of a list, as many as are given."""

    def __init__(self, item: _Part) -> None:
        self._item = item

    def end(self, found: _Found, at: int, count: int) -> int:
        if self._item.size is not None:
            return at + count * self._item.size
        for _ in range(count):
            at = self._item.end(found, at)
        return at


class _Array:
    size: Optional[int] = None

    def __init__(self, item: _Part, count: int) -> None:
        self._items, self._count = _Items(item), count

    def end(self, found: _Found, at: int) -> int:
        return self._items.end(found, at, self._count)


class _List:
    size: Optional[int] = None

    def __init__(self, item: _Part, is_longer: Optional[Callable[[int], bool]]) -> None:
        """`is_longer`: whether no frame holds so many items; None where nothing reads them."""
        self._items, self._is_longer = _Items(item), is_longer

    def end(self, found: _Found, at: int) -> int:
        count, begin = found.length(at), at + _NUMBER.size
        end = self._items.end(found, begin, count)
        too_long = self._is_longer is not None and self._is_longer(count)
        found.is_too_long |= too_long
        if (self._is_longer is None or too_long) and end <= len(found.serialized):
            found.cuts.append((begin, end))
        return end


def screener(message_type: Any, fields: Optional[Iterable[str]], lookup: Lookup, most: Optional[int] = None) -> Screen:
    """A function from a serialized message of a type to what is to be deserialized of it.

    That lacks the items of each list that none of the dotted `fields` reads, where they are not None, or that takes
    more than `most` bytes as JSON; whether there is such a long one is the second value.
    """
    message = _message(message_type, None if fields is None else list(fields), lookup, most)

    def screened(serialized: bytes) -> Tuple[bytes, bool]:
        found = _Found(serialized)
        try:
            message.end(found, 0)
        except struct.error:  # it ends too soon, which genpy tells
            return serialized, False
        if sum(end - begin for begin, end in found.cuts) < WORTH:
            return serialized, found.is_too_long
        pieces, at = [], 0
        for begin, end in found.cuts:
            pieces += [serialized[at : begin - _NUMBER.size], bytes(_NUMBER.size)]
            at = end
        return b"".join([*pieces, serialized[at:]]), found.is_too_long

    return screened


def _message(message_type: Any, fields: Optional[Sequence[str]], lookup: Lookup, most: Optional[int]) -> _Part:
    types = types_of(message_type)
    wanted: Mapping[str, Optional[Sequence[str]]]
    wanted = {sent_name(slot): None for slot in types} if fields is None else grouped(fields)
    parts = [_part(kind, wanted.get(sent_name(slot), []), lookup, most) for slot, kind in types.items()]
    return _joined(parts)


def _joined(parts: Iterable[_Part]) -> _Part:
    """Parts one behind the other, as few as there can be."""
    joined: List[_Part] = []
    for part in parts:
        last = joined[-1].size if joined else None
        if last is not None and part.size is not None:
            joined[-1] = _Fixed(last + part.size)
        else:
            joined.append(part)
    return joined[0] if len(joined) == 1 else _Message(joined) if joined else _Fixed(0)


def _part(kind: str, fields: Optional[Sequence[str]], lookup: Lookup, most: Optional[int]) -> _Part:
    array = ARRAY.fullmatch(kind)
    if array:
        item = _part(array["of"], None, lookup, None)
        if not array["size"]:
            return _List(item, _longer(array["of"], fields, lookup, most))
        count = int(array["size"])
        return _Array(item, count) if item.size is None else _Fixed(count * item.size)
    if "/" in kind:
        return _message(lookup(kind), fields, lookup, most)
    return _Text() if kind == "string" else _Fixed(_SIZES[kind])


def _longer(
    item: str, fields: Optional[Sequence[str]], lookup: Lookup, most: Optional[int]
) -> Optional[Callable[[int], bool]]:
    if fields is not None and not fields:
        return None
    if most is None:
        return lambda _: False
    room = most
    size = 4 / 3 if item in BYTES else _least(item, lookup) + 1  # and a comma
    return lambda count: count * size > room


def _least(kind: str, lookup: Lookup) -> int:
    """How many bytes a value takes as JSON at least."""
    array = ARRAY.fullmatch(kind)
    if array:
        return 2 + int(array["size"] or 0) * (1 if array["of"] in BYTES else _least(array["of"], lookup) + 1)
    if kind in ("time", "duration"):
        return len('{"sec":0,"nanosec":0}')
    if "/" not in kind:
        return 1
    fields = types_of(lookup(kind)).items()
    return 2 + sum(len(f'"{sent_name(slot)}":,') + _least(inner, lookup) for slot, inner in fields)
