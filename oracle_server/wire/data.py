"""An event's data, decoded as far as somebody reads it: what is skipped takes a tenth of the time or less."""

from __future__ import annotations

import gc
import math
import re
from collections.abc import Callable
from functools import lru_cache
from itertools import islice
from typing import Any, TypedDict, TypeVar, TypeVarTuple, Unpack

import msgspec

_LARGE = 2**16
"""Bytes from which on the garbage collector would look through what is decoded several times over."""

_MANY = 2**14
"""Bytes from which on there may be too many `_EXPONENT`s."""
MAX_EXPONENTS = 4_000
"""Numbers with such exponents that are read of one text: some take a thousand times as long as others, 10 µs each."""
_EXPONENT = re.compile(rb"e[+-]?\d{3}")

Decoded = TypeVar("Decoded")
T = TypeVar("T")
Args = TypeVarTuple("Args")
DataDecoder = msgspec.json.Decoder[dict[str, Any]]
Decoders = Callable[[str, str], DataDecoder]
"""Finds the decoder of a stream's data, by the stream's name and kind."""

_whole: DataDecoder = msgspec.json.Decoder(dict[str, Any])


def nothing(_stream: str, _kind: str) -> DataDecoder:
    """The decoder of data that nobody reads."""
    return data_decoder(frozenset())


def whole(_stream: str, _kind: str) -> DataDecoder:
    """The decoder of any data, for streams of which nothing is known."""
    return _whole


@lru_cache(maxsize=4096)
def data_decoder(fields: frozenset[str] | None) -> DataDecoder:
    """A decoder of data that keeps the fields at some dotted paths, and no others; None for all.

    It checks the syntax of the rest, and nothing more. A value that is no object, on the way to a field, is kept.
    """
    if fields is None:
        return _whole
    paths = sorted(tuple(field.split(".")) for field in fields)
    return msgspec.json.Decoder(_picked(paths))


def decoded(decoder: msgspec.json.Decoder[Decoded], text: str | msgspec.Raw) -> Decoded:
    """Decode with the garbage collector resting where there is much.

    Raises what the decoder raises, and OverflowError where there are too many numbers that take long.
    """
    size = len(text) if isinstance(text, str) else memoryview(text).nbytes
    return resting(size, careful(decoder, text, size).decode, text)


def careful(
    decoder: msgspec.json.Decoder[Decoded], text: str | bytes | msgspec.Raw, size: int
) -> msgspec.json.Decoder[Decoded]:
    """The decoder for a text of a size (bytes), or one like it that raises OverflowError beyond `MAX_EXPONENTS`."""
    if size < _MANY:
        return decoder
    data = text.encode(errors="replace") if isinstance(text, str) else bytes(text)
    capitals = data.count(b"E")
    if data.count(b"e") + capitals <= MAX_EXPONENTS:
        return decoder
    data = data.lower() if capitals else data
    if next(islice(_EXPONENT.finditer(data), MAX_EXPONENTS, None), None) is None:
        return decoder
    return msgspec.json.Decoder(decoder.type, float_hook=_Counting())


class _Counting:
    """Numbers of their texts, as long as not too many have long exponents."""

    def __init__(self) -> None:
        self._left = MAX_EXPONENTS

    def __call__(self, text: str) -> float:
        if _EXPONENT.search(text.lower().encode()):
            self._left -= 1
            if self._left < 0:
                raise OverflowError(f"more than {MAX_EXPONENTS} numbers with exponents of three digits")
        value = float(text)
        if not math.isfinite(value):
            raise ValueError("Number out of range")
        return value


def resting(size: int, work: Callable[[Unpack[Args]], T], *args: *Args) -> T:
    """Do some work with the garbage collector resting where the text that it decodes is of a large size (bytes)."""
    if size < _LARGE or not gc.isenabled():
        return work(*args)
    gc.disable()
    try:
        return work(*args)
    finally:
        gc.enable()


def _picked(paths: list[tuple[str, ...]]) -> Any:
    """The type of an object with only these fields; each has its own path before those of its parts."""
    fields: dict[str, Any] = {}
    for name in dict.fromkeys(path[0] for path in paths):
        below = [path[1:] for path in paths if path[0] == name]
        fields[name] = Any if () in below else _picked(below) | list[Any] | str | float | int | bool | None
    return TypedDict("Picked", fields, total=False)  # type: ignore[operator]
