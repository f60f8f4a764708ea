"""Errors in the frames of a monitor, or in what it asks for."""

from __future__ import annotations

from oracle_server.core.errors import OracleError
from oracle_server.wire.frames import ErrorFrame


class WireError(OracleError):
    """Something that is answered by an `error` frame; a fatal one closes the connection."""

    def __init__(
        self, code: str, message: str, *, seq: int | None = None, fatal: bool = False, session: str | None = None,
        url: str | None = None,
    ) -> None:  # fmt: skip
        super().__init__(message)
        self.code, self.message, self.seq, self.fatal, self.session = code, message, seq, fatal, session
        self.url = url

    def frame(self) -> ErrorFrame:
        """The `error` frame."""
        frame: ErrorFrame = {"type": "error", "code": self.code, "message": self.message, "fatal": self.fatal}
        if self.seq is not None:
            frame["seq"] = self.seq
        if self.session is not None:
            frame["session"] = self.session
        if self.url is not None:
            frame["url"] = self.url
        return frame
