"""Queries for how much the database has: of a session, of all, and in bytes."""

from __future__ import annotations

EXTENT = (  # each end by itself: one query for both would read all that is between
    "SELECT coalesce((SELECT min(position) FROM steps WHERE session = ?1), 1), "
    "coalesce((SELECT max(position) FROM steps WHERE session = ?1), 0)"
)
LAST_TIME = (
    "SELECT coalesce(max((SELECT judged FROM steps WHERE session = s.number ORDER BY position DESC LIMIT 1)), 0) "
    "FROM sessions s"
)
"""A session's last step was judged last; all of them would be looked at otherwise."""
KEPT = (
    "SELECT s.number, s.spec, s.closed, coalesce(saved.settled, 0) "
    "FROM sessions s LEFT JOIN snapshots saved ON saved.session = s.number ORDER BY s.number"
)
SIZE = (
    "SELECT (p.page_count - f.freelist_count) * s.page_size FROM pragma_page_count p, pragma_freelist_count f, "
    "pragma_page_size s"
)
