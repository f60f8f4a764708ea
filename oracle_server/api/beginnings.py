"""A session's episodes as Server-Sent Events: those that go on, then each as it begins and ends."""

from __future__ import annotations

from collections.abc import AsyncIterator
from functools import partial

from fastapi.sse import format_sse_event

from oracle_server.api.following import followed
from oracle_server.history.episodes import EpisodeQuery
from oracle_server.history.port import Reading
from oracle_server.history.records import SessionRecord
from oracle_server.sessions.beginnings import MOST, Beginnings, Told
from oracle_server.sessions.registry import Registry
from oracle_server.wire.json import encode

_GATHER = 0.05
"""Seconds between two looks at what was committed."""


def episode_events(
    registry: Registry, history: Reading, known: SessionRecord, properties: frozenset[str]
) -> AsyncIterator[bytes]:
    """The episodes of some properties of a session, all where none is named, until it is closed.

    Of one that is not judged here only those are told that are open at first.
    """
    live = registry.open.get(known.id)
    news = partial(_open, history, known.number) if live is None else Beginnings(live, history).news
    begun = False

    async def page() -> tuple[bytes, bool]:
        """The next events; that there are more is never known."""
        nonlocal begun
        told = [] if begun and live is None else await news()
        begun = True
        wanted = (each for each in told if not properties or each.record["property"] in properties)
        return b"".join(map(_event, wanted)), False

    return followed(registry, known.id, page, _GATHER)


async def _open(history: Reading, number: int) -> list[Told]:
    """The episodes of a session that are open."""
    page, _ = await history.episodes(EpisodeQuery(number, open=True, limit=MOST, order="desc"))
    return [Told("begun", False, record) for record in reversed(page)]


def _event(told: Told) -> bytes:
    data = {name: value for name, value in told.record.items() if name not in ("type", "event")}
    return format_sse_event(event=told.event, data_str=encode({**data, "moved": told.moved}))
