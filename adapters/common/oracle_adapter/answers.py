"""What an HTTP answer that is no WebSocket says: in the server's words, or what else answers."""

from __future__ import annotations

import json
from contextlib import suppress
from typing import TYPE_CHECKING, Optional, Union

from oracle_adapter.texts import one_line

if TYPE_CHECKING:
    from websockets.http11 import Response

_MOST = 500
"""Characters of it that are told."""


def in_words(answer: Response) -> str:
    """The status of an answer, with what it says."""
    status = f"HTTP {answer.status_code}"
    detail = _detail(answer.body)
    if detail is not None:
        return f"{status}: {one_line(detail[:_MOST])}"
    to = answer.headers.get_all("Location")
    if to:
        where = one_line(to[0].partition("?")[0][:_MOST])
        return f"{status} with {where}, which is not followed: name that server, if it is meant"
    if answer.status_code in (502, 503, 504):
        return f"{status}, as of a proxy that does not reach its server"
    return f"{status}, and not of an oracle server"


def _detail(body: Union[bytes, bytearray, None]) -> Optional[str]:
    """What the server says; None where it is not the oracle's that answers."""
    with suppress(ValueError, LookupError, TypeError):
        return str(json.loads(bytes(body or b""))["detail"])
    return None
