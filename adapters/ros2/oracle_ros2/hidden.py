"""What others may read otherwise than rclpy: texts that go on behind a NUL, and messages that are not in CDR.

Messages come in CDR (OMG's DDS-XTypes 1.3, 7.4): a number stands at a multiple of its size, counted from behind a
header of four bytes; a text is its length, its bytes and a NUL; a sequence is its length and its items. rclpy reads a
text up to its first NUL. With Fast DDS it reads other forms than CDR, too, in which others may find other fields.
"""

from __future__ import annotations

import struct
from contextlib import suppress
from typing import Any, Callable, Protocol, Sequence

from oracle_ros2.codec import SEQUENCE, load_type

_HEADER = 4
_LENGTHS = {b"\0\0": struct.Struct(">I"), b"\0\1": struct.Struct("<I")}
"""How lengths are written, by the first bytes of the header."""
_OTHERS = frozenset(bytes([0, form]) for form in range(2, 12))
"""The other forms that DDS has, as XCDR2, which nodes do not write. What is in none of DDS's is not looked at."""
_SIZES = {
    **dict.fromkeys(("boolean", "octet", "byte", "char", "int8", "uint8"), 1), **dict.fromkeys(("int16", "uint16"), 2),
    **dict.fromkeys(("int32", "uint32", "float"), 4), **dict.fromkeys(("int64", "uint64", "double"), 8),
}  # fmt: skip


class HiddenTextError(Exception):
    """A text goes on behind a NUL."""

    def __init__(self) -> None:
        super().__init__("a text has a NUL in it, behind which nothing is read here")


class OtherFormError(Exception):
    """A message is in another form than CDR."""

    def __init__(self) -> None:
        super().__init__("it is in another form than CDR, in which others may find other fields")


class _UnknownFormError(Exception):
    """Where the next field begins depends on the middleware, as behind a wide text."""


class _Data:
    """The bytes behind a message's header, and how lengths are written in them."""

    def __init__(self, view: memoryview, lengths: struct.Struct) -> None:
        self.view, self._lengths = view, lengths

    def length(self, at: int) -> tuple[int, int]:
        """The length that is written at a place, once aligned, and where that ends."""
        at += -at % 4
        (length,) = self._lengths.unpack_from(self.view, at)
        return length, at + 4


class _Part(Protocol):
    """A value in messages of a type."""

    align: int
    """The size of the largest number in it, where the place at which it begins tells where it ends; else 0."""
    has_texts: bool

    def end(self, data: _Data, at: int) -> int:
        """Where it ends that begins at a place, once aligned.

        Raises `HiddenTextError`, `_UnknownFormError`, and `struct.error` where the message ends before.
        """


class _Number:
    has_texts = False

    def __init__(self, size: int) -> None:
        self.align = size

    def end(self, _: _Data, at: int) -> int:
        return at + -at % self.align + self.align


class _Text:
    align, has_texts = 0, True

    def end(self, data: _Data, at: int) -> int:
        length, at = data.length(at)
        end = at + length
        if b"\0" in bytes(data.view[at : end - 1]):
            raise HiddenTextError
        return end


class _Wide:
    align, has_texts = 0, False

    def end(self, _: _Data, _at: int) -> int:
        raise _UnknownFormError


class _Message:
    def __init__(self, parts: Sequence[_Part]) -> None:
        self._parts = parts or [_Number(1)]  # in place of no fields
        aligns = [part.align for part in self._parts]
        self.align = max(aligns) if all(aligns) else 0
        self.has_texts = any(part.has_texts for part in parts)

    def end(self, data: _Data, at: int) -> int:
        for part in self._parts:
            at = part.end(data, at)
        return at


class _Items:
    """An array, or a sequence where `count` is None."""

    def __init__(self, item: _Part, count: int | None) -> None:
        self._item, self._count = item, count
        self.align = 0 if count is None else item.align
        self.has_texts = item.has_texts

    def end(self, data: _Data, at: int) -> int:
        left, at = data.length(at) if self._count is None else (self._count, at)
        item = self._item
        while left:
            end = item.end(data, at)
            if item.align and (end - at) % item.align == 0:  # and so for those that follow
                return at + left * (end - at)
            at, left = end, left - 1
        return at


def hidden_text_check(message_type: Any) -> Callable[[bytes], None]:
    """A function that raises `HiddenTextError` for a serialized message of a type in which a text goes on behind a NUL.

    And `OtherFormError` for one in another form of DDS's than CDR. What is behind a wide text is not looked at.
    """
    parts = _parts(message_type)
    while parts and not parts[-1].has_texts:
        parts.pop()
    message = _Message(parts)

    def check(serialized: bytes) -> None:
        form = bytes(serialized[:2])
        if form in _OTHERS:
            raise OtherFormError
        lengths = _LENGTHS.get(form)
        if parts and lengths is not None:
            with suppress(_UnknownFormError, struct.error):  # rclpy itself refuses what ends too soon
                message.end(_Data(memoryview(serialized)[_HEADER:], lengths), 0)

    return check


def _parts(message_type: Any) -> list[_Part]:
    made, fields = message_type(), message_type.get_fields_and_field_types()
    return [_part(kind, type(getattr(made, name))) for name, kind in fields.items()]


def _part(kind: str, of: Any) -> _Part:
    """What stands in a message for a field of a kind, which has values `of` a type in Python."""
    many = SEQUENCE.fullmatch(kind)
    if many:
        item = many["of"] or many["array"]
        return _Items(_part(item, load_type(item) if "/" in item else of), int(many["size"]) if many["size"] else None)
    if "/" in kind:
        return _Message(_parts(of))
    if kind.startswith("string"):
        return _Text()
    return _Number(_SIZES[kind]) if kind in _SIZES else _Wide()
