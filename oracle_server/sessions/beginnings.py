"""What one who follows a session's episodes is told: those that go on, then each as it begins and ends."""

from __future__ import annotations

from typing import NamedTuple

from oracle_server.core.episode import EpisodeRecord
from oracle_server.history.episodes import EpisodeQuery
from oracle_server.history.port import Reading
from oracle_server.sessions.live import LiveSession
from oracle_server.wire.frames import EpisodeEvent

MOST = 1_000
"""Episodes that are told at first: as many as a page of them has."""


class Told(NamedTuple):
    """What became of an episode; `moved` as in `EpisodeChange`."""

    event: EpisodeEvent
    moved: bool
    record: EpisodeRecord


class Beginnings:
    """What was told of an open session's episodes."""

    def __init__(self, live: LiveSession, history: Reading) -> None:
        """Begin with nothing told."""
        self._live, self._history = live, history
        self._count: int | None = None
        self._begun: set[tuple[str, int]] = set()

    async def news(self) -> list[Told]:
        """What was committed since the last call; at the first one, those that go on. Raises `HistoryError`."""
        feed = self._live.ledger.episodes
        frames = None if self._count is None else feed.since(self._count)
        self._count = feed.last
        if frames is not None:
            return self._new([Told(frame["event"], frame["moved"], frame) for frame in frames])
        self._begun.clear()  # it has just begun, or is too slow
        return self._new([Told("begun", False, record) for record in await self._going_on()])

    async def _going_on(self) -> list[EpisodeRecord]:
        """The episodes that are open, or may go on."""
        names, going = self._live.record.properties, set[tuple[str, int]]()
        since = None
        for judge in self._live.core.judges.values():
            for i, episode in enumerate(judge.told.following.episodes):
                if episode is not None:
                    going.add((names[i], episode.first))
                    since = episode.until if since is None else min(since, episode.until)
        if not going:
            return []
        properties = frozenset(name for name, _ in going)
        query = EpisodeQuery(self._live.number, properties, since, limit=MOST, order="desc")
        page, _ = await self._history.episodes(query)
        return [record for record in reversed(page) if (record["property"], record["first"]) in going]

    def _new(self, found: list[Told]) -> list[Told]:
        """Those that were not told yet."""
        new = []
        for told in found:
            key = told.record["property"], told.record["first"]
            if told.event != "begun":
                self._begun.discard(key)
            elif key in self._begun:
                continue
            else:
                self._begun.add(key)
            new.append(told)
        return new
