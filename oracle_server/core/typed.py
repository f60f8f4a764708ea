"""What is known of the messages of a spec's streams: their shapes, or why there is none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from oracle_server.core.events import StreamKey
from oracle_server.core.shapes import Record


@dataclass(frozen=True, slots=True)
class TypedMessage:
    """The messages of a stream: their shape, and with it what other distributions of ROS have, None for no more.

    `everywhere` are the fields that all distributions have, and of one type; None for all of the shape.
    """

    shape: Record
    anywhere: Record | None = None
    everywhere: Record | None = None
    unknown: tuple[str, ...] = ()
    """The types within it that are not known."""

    @property
    def widest(self) -> Record:
        """Every field that some distribution has."""
        return self.anywhere or self.shape

    @property
    def surest(self) -> Record:
        """The fields that each message has, whatever the distribution."""
        return self.everywhere or self.shape


@dataclass(frozen=True, slots=True)
class Missing:
    """Why a type is not known, for people, and whether a spec with it can be right; or its `package`, as a whole."""

    message: str
    severity: Literal["error", "warning"]
    package: str = ""


StreamTypes = Mapping[StreamKey, TypedMessage]
"""The messages of the streams whose types are known."""
