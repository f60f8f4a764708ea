"""Where the values of a message stand while it is serialized, so that lists can be left out that nothing reads.

Messages come in CDR (OMG's DDS-XTypes 1.3, 7.4): a number stands at a multiple of its size, counted from behind a
header of four bytes; a text is its length, its bytes and a NUL; a sequence is its length and its items.
"""

from __future__ import annotations

import struct
from typing import Any, Callable, Mapping, NamedTuple, Protocol, Sequence

from oracle_adapter.fields import grouped

from oracle_ros2.codec import SEQUENCE, least, load_type

ALIGNED = 8
"""The size of the largest number: what stands so many bytes further on looks the same."""
_SIZES = {
    **dict.fromkeys(("boolean", "octet", "byte", "char", "int8", "uint8"), 1), **dict.fromkeys(("int16", "uint16"), 2),
    **dict.fromkeys(("int32", "uint32", "float"), 4), **dict.fromkeys(("int64", "uint64", "double"), 8),
}  # fmt: skip


class HiddenTextError(Exception):
    """A text goes on behind a NUL."""

    def __init__(self) -> None:
        super().__init__("a text has a NUL in it, behind which nothing is read here")


class UnknownFormError(Exception):
    """Where the next field begins depends on the middleware, as behind a wide text."""


class Cut(NamedTuple):
    """What of a list can be left out: all from `kept` on, where its first `count` items end, up to its `end`."""

    count: int
    begin: int
    """Where its items begin, behind their number."""
    kept: int
    end: int


class Data:
    """The bytes behind a message's header, how lengths are written in them, and what was found in them so far."""

    def __init__(self, view: memoryview, lengths: struct.Struct) -> None:
        self.view, self._lengths = view, lengths
        self.cuts: list[Cut] = []
        self.is_too_long = False
        """Whether there is a list that is read and that no frame holds."""

    def length(self, at: int) -> tuple[int, int]:
        """The length that is written at a place, once aligned, and where that ends."""
        at += -at % 4
        (length,) = self._lengths.unpack_from(self.view, at)
        return length, at + 4


class Part(Protocol):
    """A value in messages of a type."""

    align: int
    """The size of the largest number in it, where the place at which it begins tells where it ends; else 0."""
    matters: bool
    """Whether it has texts, or lists that may be left out."""

    def end(self, data: Data, at: int) -> int:
        """Where it ends that begins at a place, once aligned.

        Raises `HiddenTextError`, `UnknownFormError`, and `struct.error` where the message ends before.
        """


class _Number:
    matters = False

    def __init__(self, size: int) -> None:
        self.align = size

    def end(self, _: Data, at: int) -> int:
        return at + -at % self.align + self.align


class _Text:
    align, matters = 0, True

    def end(self, data: Data, at: int) -> int:
        length, at = data.length(at)
        end = at + length
        if b"\0" in bytes(data.view[at : end - 1]):
            raise HiddenTextError
        return end


class _Wide:
    align, matters = 0, False

    def end(self, _: Data, _at: int) -> int:
        raise UnknownFormError


class _Fixed:
    """Parts that have one length at each place: it is known beforehand."""

    matters = False

    def __init__(self, parts: Sequence[Part]) -> None:
        self.align = max(part.align for part in parts)
        nothing = Data(memoryview(b""), struct.Struct("<I"))
        self._lengths = [end_of(parts, nothing, place) - place for place in range(ALIGNED)]

    def end(self, _: Data, at: int) -> int:
        return at + self._lengths[at % ALIGNED]


class Ends:
    """How many of a list's items end first at each place within eight bytes, and where they do."""

    def __init__(self, begin: int) -> None:
        self.first = {begin % ALIGNED: (0, begin)}

    def note(self, count: int, end: int) -> None:
        """So many first items end there."""
        self.first.setdefault(end % ALIGNED, (count, end))


class _Message:
    align = 0

    def __init__(self, parts: Sequence[Part]) -> None:
        self._parts = parts
        self.matters = any(part.matters for part in parts)

    def end(self, data: Data, at: int) -> int:
        return end_of(self._parts, data, at)


class _Array:
    def __init__(self, item: Part, count: int) -> None:
        self._item, self._count = item, count
        self.align, self.matters = item.align, item.matters

    def end(self, data: Data, at: int) -> int:
        return _items_end(self._item, self._count, data, at, None)


class _Sequence:
    align = 0

    def __init__(self, item: Part, is_longer: Callable[[int], bool] | None) -> None:
        """`is_longer`: whether no frame holds so many items; None where nothing reads them."""
        self._item, self._is_longer = item, is_longer
        self.matters = True

    def end(self, data: Data, at: int) -> int:
        count, begin = data.length(at)
        too_long = self._is_longer is not None and self._is_longer(count)
        data.is_too_long |= too_long
        if self._is_longer is not None and not too_long:
            return _items_end(self._item, count, data, begin, None)
        ends = Ends(begin)
        end = _items_end(self._item, count, data, begin, ends)
        kept, place = ends.first[end % ALIGNED]
        if end - place >= ALIGNED and end <= len(data.view):
            data.cuts.append(Cut(kept, begin, place, end))
        return end


def end_of(parts: Sequence[Part], data: Data, at: int) -> int:
    """Where some parts end, one behind the other, that begin at a place; raises as one does."""
    for part in parts:
        at = part.end(data, at)
    return at


def _items_end(item: Part, count: int, data: Data, at: int, ends: Ends | None) -> int:
    """Where so many items end that begin at a place; also notes where the first ones do."""
    for left in range(count, 0, -1):
        end = item.end(data, at)
        size = end - at
        if item.align and size % item.align == 0:  # and so for those that follow
            if ends is not None:
                for more in range(1, min(left, ALIGNED) + 1):
                    ends.note(count - left + more, at + more * size)
            return at + left * size
        at = end
        if ends is not None:
            ends.note(count - left + 1, at)
    return at


def parts_of(message_type: Any, fields: Sequence[str] | None, most: int | None) -> list[Part]:
    """The parts of messages of a type of which these dotted fields are read, None for all.

    `most`: as for `codec.reader`.
    """
    made, types = message_type(), message_type.get_fields_and_field_types()
    wanted: Mapping[str, Sequence[str] | None] = dict.fromkeys(types) if fields is None else grouped(fields)
    found = [_part(kind, type(getattr(made, name)), wanted.get(name, []), most) for name, kind in types.items()]
    return _joined(found) or [_Number(1)]  # in place of no fields


def _joined(parts: Sequence[Part]) -> list[Part]:
    """The same with as few parts."""
    joined: list[Part] = []
    fixed: list[Part] = []
    for part in [*parts, None]:
        if part is not None and part.align:
            fixed.append(part)
            continue
        if fixed:
            joined.append(_Fixed(fixed) if len(fixed) > 1 else fixed[0])
            fixed = []
        if part is not None:
            joined.append(part)
    return joined


def _longer(item: str, fields: Sequence[str] | None, most: int | None) -> Callable[[int], bool] | None:
    if fields is not None and not fields:
        return None
    if most is None:
        return lambda _: False
    size, room = least(item), most
    return lambda count: count * size > room


def _part(kind: str, of: Any, fields: Sequence[str] | None, most: int | None) -> Part:
    """What stands in a message for a field of a kind, which has values `of` a type in Python."""
    many = SEQUENCE.fullmatch(kind)
    if many:
        item = many["of"] or many["array"]
        part = _part(item, load_type(item) if "/" in item else of, None, None)
        return _Array(part, int(many["size"])) if many["size"] else _Sequence(part, _longer(item, fields, most))
    if "/" in kind:
        parts = parts_of(of, fields, most)
        return parts[0] if len(parts) == 1 else _Message(parts)
    if kind.startswith("string"):
        return _Text()
    return _Number(_SIZES[kind]) if kind in _SIZES else _Wide()
