"""Errors in the frames of a monitor, or in what it asks for."""

from __future__ import annotations

from typing import Any

from oracle_server.core.errors import OracleError


class WireError(OracleError):
    """Something that is answered by an `error` frame; a fatal one closes the connection."""

    def __init__(
        self, code: str, message: str, *, seq: int | None = None, fatal: bool = False, session: str | None = None
    ) -> None:
        super().__init__(message)
        self.code, self.message, self.seq, self.fatal, self.session = code, message, seq, fatal, session

    def frame(self) -> dict[str, Any]:
        """The `error` frame."""
        frame: dict[str, Any] = {"type": "error", "code": self.code, "message": self.message, "fatal": self.fatal}
        more = {"seq": self.seq, "session": self.session}
        return frame | {key: value for key, value in more.items() if value is not None}
