"""What is said of an answer that is no WebSocket."""

from __future__ import annotations

from typing import Dict

import pytest
from oracle_adapter.answers import in_words
from websockets.datastructures import Headers
from websockets.http11 import Response


@pytest.mark.parametrize(
    ("status", "headers", "body", "said"),
    [
        (403, {}, b'{"detail": "the token lacks\\n it"}', r"HTTP 403: the token lacks\n it"),
        (404, {}, b"<html>", "HTTP 404, and not of an oracle server"),
        (404, {}, b"[1]", "HTTP 404, and not of an oracle server"),
        (401, {}, b"\xff", "HTTP 401, and not of an oracle server"),
        (502, {}, b"", "HTTP 502, as of a proxy that does not reach its server"),
        (301, {"Location": "https://h/api?token=x"}, b"",
         "HTTP 301 with https://h/api, which is not followed: name that server, if it is meant"),
    ],
)  # fmt: skip
def test_answers(status: int, headers: Dict[str, str], body: bytes, said: str) -> None:
    assert in_words(Response(status, "no", Headers(headers), body)) == said
