"""Bodies of requests that do not come."""

from __future__ import annotations

import asyncio
from contextlib import suppress

import pytest
from fastapi import HTTPException
from starlette.types import Message, Receive, Scope, Send

from oracle_server.edge import bodies
from oracle_server.edge.bodies import Bodies
from tests.processes import PATIENCE


async def test_a_body_that_does_not_come_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bodies, "BODY_WITHIN", 0.01)

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        assert await receive()
        await receive()

    pieces = iter([{"type": "http.request", "body": b"x", "more_body": True}])

    async def receive() -> Message:
        with suppress(StopIteration):
            return next(pieces)
        return await asyncio.Future()

    async def send(_: Message) -> None:
        raise AssertionError

    async with asyncio.timeout(PATIENCE):
        with pytest.raises(HTTPException, match="408"):
            await Bodies(app)({"type": "http", "path": "/"}, receive, send)


async def test_a_body_that_does_not_come_ends_no_answer_that_has_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    """As who streams reads on until the client leaves, however much of its body is missing, or how large it is."""
    monkeypatch.setattr(bodies, "BODY_WITHIN", 0.01)
    monkeypatch.setattr(bodies, "MAX_BODY", 3)
    left, asked, heard, sent = asyncio.Event(), asyncio.Event(), list[Message](), list[Message]()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        heard.append(await receive())
        reading = asyncio.ensure_future(receive())
        await asked.wait()
        await send({"type": "http.response.start", "status": 200, "headers": []})
        heard.extend([await reading, await receive()])

    pieces = [{"type": "http.request", "body": b"x", "more_body": True}]
    pieces += [{"type": "http.request", "body": b"xxxx", "more_body": True}]

    async def receive() -> Message:
        if len(heard) == 1 and not sent:
            asked.set()
            await asyncio.Future()
        if pieces:
            return pieces.pop(0)
        await left.wait()
        return {"type": "http.disconnect"}

    async def send(message: Message) -> None:
        sent.append(message)
        left.set()

    async with asyncio.timeout(PATIENCE):
        await Bodies(app)({"type": "http", "path": "/"}, receive, send)
    assert [message["type"] for message in heard] == ["http.request", "http.request", "http.disconnect"]


REFUSED = [
    ((b"content-type", b"multipart/form-data; boundary=x"), "a form is not read: send the file itself as the body, as"),
    ((b"content-encoding", b"GZIP"), "a compressed body is not read: send it as it is"),
]


@pytest.mark.parametrize(("header", "reason"), REFUSED, ids=["form", "compressed"])
async def test_what_is_not_the_body_itself_is_refused(header: tuple[bytes, bytes], reason: str) -> None:
    """As `curl -F` sends it: what stands around the file was taken for its first lines."""

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await receive()

    async def nothing() -> Message:
        raise AssertionError

    async def send(_: Message) -> None:
        raise AssertionError

    with pytest.raises(HTTPException, match=f"415: {reason}"):
        await Bodies(app)({"type": "http", "path": "/", "headers": [header]}, nothing, send)


async def test_a_body_that_says_that_it_is_not_compressed_is_read() -> None:
    got: list[Message] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        got.append(await receive())

    async def receive() -> Message:
        return {"type": "http.request", "body": b"x"}

    async def send(_: Message) -> None:
        raise AssertionError

    await Bodies(app)({"type": "http", "path": "/", "headers": [(b"content-encoding", b"identity")]}, receive, send)
    assert got == [{"type": "http.request", "body": b"x"}]
