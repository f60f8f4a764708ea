"""Answers that are compressed where the client takes that and it pays: in a thread, and a file once for all."""

from __future__ import annotations

import asyncio
import gzip
from collections.abc import Callable
from functools import partial
from hashlib import sha256

from starlette.requests import Request
from starlette.responses import Response

from oracle_server.history.port import Reading
from oracle_server.wire.json import encode_bytes

_LEAST = 1_400
"""Bytes that go into one packet, which compression would make no fewer."""
_LEVEL = 5
_VARIES = {"Vary": "Accept-Encoding"}
_PACKED = {**_VARIES, "Content-Encoding": "gzip"}


def takes_gzip(request: Request) -> bool:
    """Whether a client says that it reads gzip (RFC 9110, 12.5.3)."""
    offers = {}
    for offer in ",".join(request.headers.getlist("accept-encoding")).lower().split(","):
        coding, _, parameters = offer.partition(";")
        offers[coding.strip()] = _weight(parameters)
    return offers.get("gzip", offers.get("x-gzip", offers.get("*", 0.0))) > 0


def _weight(parameters: str) -> float:
    name, _, value = parameters.replace(" ", "").partition("=")
    try:
        return float(value) if name == "q" else 1.0
    except ValueError:
        return 0.0


def packed(body: bytes) -> bytes:
    """A body as gzip, the same each time. The interpreter is not held meanwhile."""
    return gzip.compress(body, _LEVEL, mtime=0)


async def json_answer(request: Request, history: Reading, document: object) -> Response:
    """A document as JSON, which is encoded and compressed in a thread that reads for the client."""
    return await packed_answer(request, history, partial(encode_bytes, document))


async def packed_answer(request: Request, history: Reading, make: Callable[[], bytes]) -> Response:
    """What is made, which is JSON; it is made and compressed in a thread that reads for the client."""
    compress = takes_gzip(request)

    def body() -> tuple[bytes, bool]:
        plain = make()
        small = not compress or len(plain) < _LEAST
        return (plain, False) if small else (packed(plain), True)

    content, is_packed = await history.in_thread(body)
    return Response(content, media_type="application/json", headers=_PACKED if is_packed else _VARIES)


async def tagged_answer(request: Request, history: Reading, make: Callable[[], bytes]) -> Response:
    """The same with an `ETag`, and 304 where the client has it already."""
    compress = takes_gzip(request)

    def body() -> tuple[bytes, str, bool]:
        plain = make()
        is_packed = compress and len(plain) >= _LEAST
        tag = _tag(plain, is_packed)
        if _is_known(tag, request):
            return b"", tag, is_packed
        return packed(plain) if is_packed else plain, tag, is_packed

    content, tag, is_packed = await history.in_thread(body)
    if not content:
        return Response(status_code=304, headers={**_VARIES, "ETag": tag})
    headers = {**(_PACKED if is_packed else _VARIES), "ETag": tag}
    return Response(content, media_type="application/json", headers=headers)


def _tag(plain: bytes, is_packed: bool) -> str:
    """What tells a body from others, as it is sent."""
    return f'"{sha256(plain).hexdigest()[:32]}{"-gzip" if is_packed else ""}"'


class File:
    """A file that is served as it is, with a tag by which clients keep it; compressed once, where one asks for that."""

    def __init__(self, content: bytes, kind: str, headers: dict[str, str]) -> None:
        """A file's content, its media type and the headers that it is served with."""
        self._plain = content
        self._packed: bytes | None = None
        """Compressed, or empty where that is no shorter; None before the first asks."""
        self._kind, self._headers = kind, headers
        self._tags = {is_packed: _tag(content, is_packed) for is_packed in (False, True)}

    async def answer(self, request: Request) -> Response:
        """The file, or 304 where the client has it already."""
        shorter = await self._shorter() if takes_gzip(request) else b""
        tag = self._tags[bool(shorter)]
        headers = {**self._headers, **_VARIES, "ETag": tag}
        if _is_known(tag, request):
            return Response(status_code=304, headers=headers)
        if not shorter:
            return Response(self._plain, media_type=self._kind, headers=headers)
        return Response(shorter, media_type=self._kind, headers={**headers, **_PACKED})

    async def _shorter(self) -> bytes:
        if self._packed is None:
            found = await asyncio.to_thread(packed, self._plain)
            self._packed = found if len(found) < len(self._plain) else b""
        return self._packed


def _is_known(tag: str, request: Request) -> bool:
    known = ",".join(request.headers.getlist("if-none-match")).split(",")
    return any(one.strip().removeprefix("W/") in (tag, "*") for one in known)
