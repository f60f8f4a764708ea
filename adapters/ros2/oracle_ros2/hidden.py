"""Messages as they are to be read: without what others may read otherwise than rclpy, and the lists that nothing reads.

rclpy reads a text up to its first NUL. With Fast DDS it reads other forms than CDR, too, in which others may find other
fields. And it makes an object of every item of a list: a path of 20,000 poses would take it more than a second, in
which no other message is taken and no thread gets the interpreter.
"""

from __future__ import annotations

import struct
from contextlib import suppress
from typing import Any, Callable, Iterable, Sequence

from oracle_ros2.layout import Cut, Data, HiddenTextError, UnknownFormError, end_of, parts_of

__all__ = ["HiddenTextError", "OtherFormError", "screener"]

_HEADER = 4
_LENGTHS = {b"\0\0": struct.Struct(">I"), b"\0\1": struct.Struct("<I")}
"""How lengths are written, by the first bytes of the header."""
_OTHERS = frozenset(bytes([0, form]) for form in range(2, 12))
"""The other forms that DDS has, as XCDR2, which nodes do not write. What is in none of DDS's is not looked at."""
WORTH = 256
"""Bytes that a message is to be shorter by for it to be written anew."""


class OtherFormError(Exception):
    """A message is in another form than CDR."""

    def __init__(self) -> None:
        super().__init__("it is in another form than CDR, in which others may find other fields")


def screener(
    message_type: Any, fields: Iterable[str] | None = None, most: int | None = None
) -> Callable[[bytes], tuple[bytes, bool]]:
    """A function from a serialized message of a type to what is to be deserialized of it.

    That has a few items at most of each list that none of the dotted `fields` reads, or that takes more than `most`
    bytes as JSON; whether there is such a long one is the second value. Where a field is read all of it is there.

    Raises `HiddenTextError` where a text goes on behind a NUL, and `OtherFormError` for a message in another form of
    DDS's than CDR. Behind a wide text neither texts nor lists are looked at.
    """
    parts = parts_of(message_type, None if fields is None else list(fields), most)
    while parts and not parts[-1].matters:
        parts.pop()

    def screened(serialized: bytes) -> tuple[bytes, bool]:
        form = bytes(serialized[:2])
        if form in _OTHERS:
            raise OtherFormError
        lengths = _LENGTHS.get(form)
        if not parts or lengths is None:
            return serialized, False
        data = Data(memoryview(serialized)[_HEADER:], lengths)
        with suppress(UnknownFormError, struct.error):  # rclpy itself refuses what ends too soon
            end_of(parts, data, 0)
        if sum(cut.end - cut.kept for cut in data.cuts) < WORTH:
            return serialized, data.is_too_long
        return _without(serialized, data.cuts, lengths), data.is_too_long

    return screened


def _without(serialized: bytes, cuts: Sequence[Cut], lengths: struct.Struct) -> bytes:
    """The message without what can be left out: as that is a multiple of eight bytes long, all else stays in line."""
    pieces, at = [], 0
    for cut in cuts:
        begin, kept, end = (place + _HEADER for place in (cut.begin, cut.kept, cut.end))
        pieces += [serialized[at : begin - lengths.size], lengths.pack(cut.count), serialized[begin:kept]]
        at = end
    return b"".join([*pieces, serialized[at:]])
