"""Episodes that were open when the judging of a recording was cut off: they end with its last row."""

from __future__ import annotations

import msgspec

from oracle_server.core.episode import Episode, EpisodeRecord, Worst
from oracle_server.core.verdicts import NEGATIVE
from oracle_server.history.episodes import Cursor, EpisodeQuery, StoredEpisode
from oracle_server.history.port import Reading
from oracle_server.history.records import SessionRecord, StoredStep
from oracle_server.sessions.last import last_rows

_PAGE = 1_000
"""Episodes that are read at once."""


async def left_open(history: Reading, record: SessionRecord) -> list[StoredEpisode]:
    """The episodes that are open, as they end with the last rows: what is kept of them is their last change.

    Raises `HistoryError`.
    """
    rows = await last_rows(history, record)
    found: list[StoredEpisode] = []
    after: Cursor | None = None
    while True:
        query = EpisodeQuery(session=record.number, open=True, after=after, limit=_PAGE)
        page, after = await history.episodes(query)
        for each in page:
            index = record.properties.index(each["property"])
            row = rows[each["order"]].of(index) if each["order"] in rows else None
            if row is not None and row.outcomes[index] in NEGATIVE:
                found.append(_ended(each, (row.position - 1) * len(record.properties) + index + 1, row))
        if after is None:
            return found


def _ended(known: EpisodeRecord, last: int, row: StoredStep) -> StoredEpisode:
    """An episode that ends with a verdict, of a row."""
    worst = None if known["worst"] is None else msgspec.convert(known["worst"], Worst)
    ended = Episode(
        known["first"], known["began"], max(known["first"], last), max(known["began"], row.step.time), open=False,
        final=known["final"], count=known["count"], worst=worst,
    )  # fmt: skip
    return StoredEpisode(known["property"], known["order"], ended)
