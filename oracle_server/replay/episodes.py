"""The episodes of a replay, by what its rows do with them: those of the verdicts that stand in the end."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from oracle_server.core.naming import moment
from oracle_server.core.units import counted
from oracle_server.core.verdicts import Judged, explain
from oracle_server.history.episodes import EpisodeQuery, KeptEpisodes, StoredEpisode, stored_episodes


class Episodes:
    """Keeps the episodes of some properties, those of both orders where there are two."""

    def __init__(self, properties: Sequence[str]) -> None:
        self._properties, self._kept = properties, KeptEpisodes()

    def follow(self, groups: Iterable[list[Judged]]) -> Iterator[list[Judged]]:
        """Take the rows that a session gives, and pass them on."""
        for group in groups:
            for row in group:
                if row.episodes:
                    self._take(row)
            yield group

    def _take(self, row: Judged) -> None:
        begins = [c.index for c in row.episodes if c.kind == "begins" and c.text is None]
        found = {i: why for i in begins if (why := explain(row, row.verdicts[i])) is not None}
        self._kept.keep(stored_episodes(row, self._properties, found))

    def all(self) -> list[StoredEpisode]:
        """All of them, the oldest first."""
        return sorted(self._kept.matching(EpisodeQuery()), key=lambda each: (each.episode.began, each.episode.first))


def line(stored: StoredEpisode) -> str:
    """An episode in one line: its first explanation, how many violations it is, and when it ended."""
    episode = stored.episode
    text = stored.text or f"{stored.property} does not hold at {moment(episode.began)}"
    if episode.count > 1:
        text += f"; {counted(episode.count, 'violation')} until {moment(episode.until)}"
    return f"{text}; violated at the end" if episode.open else text
