"""The one error of this package."""

from __future__ import annotations

from typing import Optional

from oracle_adapter.texts import one_line

ENDING = frozenset(
    {
        "bad_attach",
        "forbidden",
        "monitor_taken",
        "needs_feature",
        "read_only",
        "replaced",
        "session_closed",
        "spec_mismatch",
        "unauthorized",
        "unknown_session",
        "unknown_spec",
    }
)
"""The server's codes after which attaching again can't succeed."""


class LinkError(Exception):
    """Something went wrong on the link.

    `code` is the server's, or one of the link's own: `unreachable`, `disconnected`, `bad_frame`,
    `lost`, `timeout`, `closed`, `misdirected`, `internal`. `seq` is the number of the event that
    was refused, where it is about one; `url`, with `moved`, the server that has the session. After
    a `fatal` error the link is over; after others it goes on.
    """

    def __init__(
        self,
        code: str,
        message: str,
        *,
        seq: Optional[int] = None,
        fatal: bool = False,
        url: Optional[str] = None,
    ) -> None:
        super().__init__(code, message)
        self.code, self.message, self.seq, self.fatal, self.url = code, message, seq, fatal, url

    def __str__(self) -> str:
        return one_line(f"{self.code}: {self.message}")
