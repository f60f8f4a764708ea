"""A session's episodes as Server-Sent Events: those that go on, then each as it begins and ends."""

from __future__ import annotations

from collections.abc import AsyncIterator

from fastapi.sse import format_sse_event

from oracle_server.api.following import followed
from oracle_server.history.port import Reading
from oracle_server.history.records import SessionRecord
from oracle_server.sessions.beginnings import Beginnings, Told
from oracle_server.sessions.registry import Registry
from oracle_server.wire.json import encode

_GATHER = 0.05
"""Seconds between two looks at what was committed."""


def episode_events(
    registry: Registry, history: Reading, known: SessionRecord, properties: frozenset[str]
) -> AsyncIterator[bytes]:
    """The episodes of some properties of a session, all where none is named, until it is closed."""
    live = registry.open.get(known.id)
    beginnings = None if live is None else Beginnings(live, history)

    async def page() -> tuple[bytes, bool]:
        """The next events; that there are more is never known."""
        told = [] if beginnings is None else await beginnings.news()
        wanted = (each for each in told if not properties or each.record["property"] in properties)
        return b"".join(map(_event, wanted)), False

    return followed(registry, known.id, page, _GATHER)


def _event(told: Told) -> bytes:
    data = {name: value for name, value in told.record.items() if name not in ("type", "event")}
    return format_sse_event(event=told.event, data_str=encode({**data, "moved": told.moved}))
