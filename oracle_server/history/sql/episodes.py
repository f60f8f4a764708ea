"""Episodes in SQLite: kept with one statement, which takes them as one text, and read by pages."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import msgspec

from oracle_server.core.episode import Episode
from oracle_server.history.episodes import Cursor, EpisodeQuery, Page, StoredEpisode, told, worst_of
from oracle_server.history.sql.damage import readable
from oracle_server.history.sql.database import Database
from oracle_server.history.sql.whose import among, joined, of

KEEP = """
INSERT INTO episodes (session, property, first, ord, began, last, until, open, final, count, worst, explanation)
SELECT json_extract(value, '$[0]'), json_extract(value, '$[1]'), json_extract(value, '$[2]'),
    json_extract(value, '$[3]'), json_extract(value, '$[4]'), json_extract(value, '$[5]'),
    json_extract(value, '$[6]'), json_extract(value, '$[7]'), json_extract(value, '$[8]'),
    json_extract(value, '$[9]'), json_extract(value, '$[10]'), json_extract(value, '$[11]')
FROM json_each(?) WHERE true
ON CONFLICT (session, property, first) DO UPDATE SET
    began = excluded.began, last = excluded.last, until = excluded.until, open = excluded.open,
    final = excluded.final, count = excluded.count, worst = excluded.worst,
    explanation = coalesce(episodes.explanation, excluded.explanation)
"""
"""Keep episodes, given as one text: the writer needs the interpreter once a statement."""
FORGET_GONE = """
DELETE FROM episodes WHERE (session, property, first) IN
    (SELECT json_extract(value, '$[0]'), json_extract(value, '$[1]'), json_extract(value, '$[2]') FROM json_each(?))
"""
"""Forget episodes of which nothing stands any more, given as one text."""
END = "UPDATE episodes SET open = false WHERE session = ? AND open"
"""Have none of a session open: it is closed."""
_ENDED = """
session = ?1 AND NOT open AND last <=
    (?2 - 1) * (SELECT json_array_length(properties) FROM sessions WHERE number = ?1)
"""
_UPTO = (
    "coalesce((SELECT upto FROM forgotten f WHERE f.session = e.session AND f.property = e.property AND f.ord = e.ord)"
    ", 0)"
)
COUNT = f"""
INSERT INTO forgotten (session, property, ord, upto, count, first)
SELECT session, property, ord, max(first), sum(count), min(first) FROM episodes e
WHERE {_ENDED} AND first > {_UPTO} GROUP BY session, property, ord
ON CONFLICT (session, property, ord) DO UPDATE SET upto = excluded.upto, count = forgotten.count + excluded.count
"""  # noqa: S608 -- no value is in it
"""Keep what those tell of violations that have ended before a position of a session, for them to be forgotten.

Those of a property follow each other: one that is brought or kept again is not counted twice.
"""
FORGET = f"DELETE FROM episodes WHERE {_ENDED}"  # noqa: S608
"""Forget those that have ended before a position of a session."""
VIOLATIONS = f"""
SELECT property, sum(count) AS violations, min(first) AS first FROM (
    SELECT property, count, first FROM forgotten WHERE session = s.number AND ord = s.decides
    UNION ALL
    SELECT property, count, first FROM episodes e
    WHERE session = s.number AND ord = s.decides AND first > {_UPTO}
) AS counted GROUP BY property
"""  # noqa: S608
"""How many violations each property of a session `s` has had in the order that decides, and the first one's number."""
_COLUMNS = (
    "e.session, s.id, s.spec, e.property, e.ord, e.first, e.began, e.last, e.until, e.open, e.final, e.count, e.worst, "
    "e.explanation"
)
_encode = msgspec.json.Encoder().encode


def keeping(session: int, episodes: Sequence[StoredEpisode]) -> list[tuple[str, tuple[str]]]:
    """The statements that keep episodes, and forget those that are gone, with their values."""
    gone = [(session, e.property, e.episode.first) for e in episodes if e.gone]
    kept = [_row(session, e) for e in _latest(episodes) if not e.gone]
    statements = [(FORGET_GONE, (_encode(gone).decode(),))] if gone else []
    return statements + ([(KEEP, (_encode(kept).decode(),))] if kept else [])


def _latest(episodes: Sequence[StoredEpisode]) -> Iterable[StoredEpisode]:
    """Each episode once, for it to be one row: as it is given last, with the explanation that it is given first."""
    latest: dict[tuple[str, int], StoredEpisode] = {}
    for each in episodes:
        key = each.property, each.episode.first
        known = latest.pop(key, None)
        latest[key] = each if known is None or known.text is None or known.gone else each._replace(text=known.text)
    return latest.values()


def _row(session: int, stored: StoredEpisode) -> tuple[Any, ...]:
    e = stored.episode
    worst = None if e.worst is None else _encode(e.worst).decode()
    return (
        session, stored.property, e.first, stored.order, e.began, e.last, e.until, int(e.open), int(e.final), e.count,
        worst, stored.text,
    )  # fmt: skip


def read(reader: Database, query: EpisodeQuery) -> Page:
    """A page of the episodes that a query asks for."""
    where, values = _conditions(query)
    direction = query.order.upper()
    by = ", ".join(f"e.{name} {direction}" for name in ("began", "session", "property", "first"))
    sql = (
        f"SELECT {_COLUMNS} FROM episodes e JOIN sessions s ON s.number = e.session "  # noqa: S608 -- no value is in it
        f"WHERE {where} ORDER BY {by} LIMIT ?"
    )
    rows = reader.execute(sql, [*values, query.limit + 1]).fetchall()
    page = rows[: query.limit]
    records = [told(row[1], row[2], _stored(row)) for row in page]
    if len(rows) <= query.limit:
        return records, None
    number, _, _, prop, _, first, began, *_ = page[-1]
    return records, Cursor(began, number, prop, first)


@readable(lambda row: f"the episode of {row[3]} at verdict {row[5]} of session {row[1]}")
def _stored(row: tuple[Any, ...]) -> StoredEpisode:
    _, _, _, prop, order, first, began, last, until, is_open, final, count, worst, text = row
    episode = Episode(first, began, last, until, bool(is_open), bool(final), count, worst_of(worst))
    return StoredEpisode(prop, order, episode, text)


def _conditions(query: EpisodeQuery) -> tuple[str, list[Any]]:
    wanted = of(query.whose, "s")
    if query.session is not None:
        wanted.append(("e.session = ?", (query.session,)))
    if query.properties:
        wanted.append(among("e.property", query.properties))
    if query.since is not None:
        wanted.append(("(e.open OR e.until >= ?)", (query.since,)))
    if query.until is not None:
        wanted.append(("e.began <= ?", (query.until,)))
    if query.open is not None:
        wanted.append(("e.open" if query.open else "NOT e.open", ()))
    if query.after is not None:
        sign = ">" if query.order == "asc" else "<"
        wanted.append((f"(e.began, e.session, e.property, e.first) {sign} (?, ?, ?, ?)", query.after))
    return joined(wanted)
