"""Plain values as JSON."""

from __future__ import annotations

from typing import Any

import msgspec


def encode(frame: Any) -> str:
    """A frame, or any plain value, as JSON text."""
    return encode_bytes(frame).decode()


def encode_bytes(frame: Any) -> bytes:
    """The same in UTF-8."""
    return msgspec.json.encode(frame)
