"""Statements as PostgreSQL has them, and texts that it takes.

The history's statements are written as SQLite has them. What differs is few: places for values, and what stands here.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any

import msgspec

from oracle_server.history.sql.episodes import FORGET_GONE, KEEP
from oracle_server.history.sql.schema import DDL
from oracle_server.history.sql.standing import RESTATE
from oracle_server.history.sql.statements import BESIDE, KEPT, SIZE

_RESTATE = """
UPDATE steps SET
    standing = new.standing,
    standing_degraded = new.degraded,
    standing_explanations = new.explanations,
    explanations = coalesce(steps.explanations, CASE WHEN new.explanations IS NOT NULL THEN '{}' END),
    revised = (coalesce(steps.revised, '{}')::jsonb || new.revised::jsonb)::text
FROM (
    SELECT (value->>0)::bigint AS session, (value->>1)::bigint AS position, value->>2 AS standing,
        value->>3 AS degraded, value->>4 AS explanations, value->>5 AS revised
    FROM json_array_elements(?::json) AS value
) AS new
WHERE steps.session = new.session AND steps.position = new.position
"""
_KEEP = """
INSERT INTO episodes (session, property, first, ord, began, last, until, open, final, count, worst, explanation)
SELECT (value->>0)::bigint, value->>1, (value->>2)::bigint, value->>3, (value->>4)::bigint, (value->>5)::bigint,
    (value->>6)::bigint, (value->>7)::boolean, (value->>8)::bigint, (value->>9)::bigint, value->>10, value->>11
FROM json_array_elements(?::json) AS value
ON CONFLICT (session, property, first) DO UPDATE SET
    began = excluded.began, last = excluded.last, until = excluded.until, open = excluded.open,
    final = excluded.final, count = excluded.count, worst = excluded.worst,
    explanation = coalesce(episodes.explanation, excluded.explanation)
"""
_FORGET_GONE = """
DELETE FROM episodes WHERE (session, property, first) IN
    (SELECT (value->>0)::bigint, value->>1, (value->>2)::bigint FROM json_array_elements(?::json) AS value)
"""
_BESIDE = (
    "(200 + pg_column_size(s.text) + coalesce(pg_column_size(s.state), 0) + coalesce(pg_column_size(saved.data), 0) "
    "+ (SELECT coalesce(sum(length(monitor) + length(code) + length(message) + 90), 0) FROM refused "
    "WHERE session = s.number))::bigint"
)
_SIZE = f"""
SELECT coalesce((
    SELECT (avg(pg_column_size(newest.*)) * 1.2 + 150)::bigint
    FROM (SELECT * FROM steps ORDER BY session DESC, position DESC LIMIT 500) AS newest
), 0) * coalesce((
    SELECT sum(
        coalesce((SELECT max(position) FROM steps WHERE session = s.number), 0)
        - coalesce((SELECT min(position) FROM steps WHERE session = s.number), 1) + 1
    )::bigint
    FROM sessions s
), 0) + coalesce((
    SELECT sum({_BESIDE})::bigint FROM sessions s LEFT JOIN snapshots saved ON saved.session = s.number
), 0) + 100000
"""  # noqa: S608 -- no value is written into it
"""What the rows take, by the newest of them: files do not become smaller where rows are deleted, only free for others.

A row has 150 bytes beside its columns, in its page's head and in indexes, and a fifth more in blocks.
"""

_KEPT = KEPT.replace(
    "s.closed",
    "CASE WHEN s.closed IS NOT NULL THEN "
    "coalesce((SELECT ended FROM forwarded WHERE session = s.number), s.closed) END",
    1,
)
"""What robots forward may have come long after it was closed: its age counts from then."""

_PARTS = {
    KEPT: _KEPT,
    RESTATE: _RESTATE,
    KEEP: _KEEP,
    FORGET_GONE: _FORGET_GONE,
    SIZE: _SIZE,
    BESIDE: _BESIDE,
    " GLOB '*' || ? || '*'": " ~ ?",
    "json_array_length(properties)": "json_array_length(properties::json)",
}
"""Statements, and parts of statements, that are otherwise."""
_AS_ONE_TEXT = frozenset({RESTATE, KEEP, FORGET_GONE})
"""Statements that take all rows as one JSON text, in which there are texts."""
_PLACE = re.compile(r"\?(\d*)")

_SIGN = "\1"
_ENCODED = {"\0": _SIGN + "0", _SIGN: _SIGN + "1"}
_DECODED = {"0": "\0", "1": _SIGN}
_SPECIAL = re.compile("[\0\1]")
_MARKED = re.compile("\1(.)", re.DOTALL)

_encode = msgspec.json.Encoder().encode
_decode = msgspec.json.decode


def tables() -> str:
    """The statements that make the tables: of 64-bit numbers, and of texts that are in the order of their bytes."""
    made = DDL.replace(" WITHOUT ROWID", "").replace("open INTEGER", "open BOOLEAN")
    return re.sub(r"\bTEXT\b", 'TEXT COLLATE "C"', re.sub(r"\bINTEGER\b", "BIGINT", made))


@lru_cache(1_000)
def translated(sql: str) -> str:
    """A statement as PostgreSQL has it, with places that are numbered."""
    for theirs, own in _PARTS.items():
        sql = sql.replace(theirs, own)
    count = 0

    def place(found: re.Match[str]) -> str:
        nonlocal count
        count += 1
        return f"${found[1] or count}"

    return _PLACE.sub(place, sql)


def values_of(sql: str, values: Any) -> Any:
    """The values of a statement; where these are texts in a JSON text, with those as `encoded`."""
    if sql in _AS_ONE_TEXT and ("\\u0000" in values[0] or "\\u0001" in values[0]):
        rows = _decode(values[0])
        made = [[encoded(value) if isinstance(value, str) else value for value in row] for row in rows]
        return (_encode(made).decode(),)
    return values


def encoded(text: str) -> str:
    """A text without the character 0, which PostgreSQL's texts can't have: it is written as two, as is the next one."""
    if "\0" in text or _SIGN in text:
        return _SPECIAL.sub(lambda found: _ENCODED[found[0]], text)
    return text


def decoded(text: str) -> str:
    """The same, back."""
    return _MARKED.sub(lambda found: _DECODED[found[1]], text) if _SIGN in text else text
