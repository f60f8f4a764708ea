"""Which server has which session, by the tables `nodes` and `owners`: as statements.

An open session has the node in `owners` that may write it, and that alone may be asked for decisions on it. It changes
only where that node's lease has run out by the database's clock, in a transaction that takes the lease away for good.
"""

from __future__ import annotations

from oracle_server.history.sql.episodes import VIOLATIONS
from oracle_server.history.sql.schema import SESSION_COLUMNS
from oracle_server.history.sql.statements import COUNTED, OF_A_SESSION

_COLUMNS = ",".join(f"s.{name}" for name in SESSION_COLUMNS)

RESERVE = "INSERT INTO owners (id, node) VALUES (?, ?) ON CONFLICT DO NOTHING"
RESERVED = (
    "SELECT o.session, o.node, EXISTS (SELECT 1 FROM sessions s WHERE s.id = o.id), "
    "EXISTS (SELECT 1 FROM sessions s WHERE s.number = o.session) FROM owners o WHERE o.id = ?"
)
UNRESERVE = "DELETE FROM owners WHERE session = ? AND node = ? AND id NOT IN (SELECT id FROM sessions WHERE number = ?)"
"""Give a number up that no session got."""
OWN = "INSERT INTO owners (session, id, node) VALUES (?, ?, ?) ON CONFLICT DO NOTHING"
DISOWN = "DELETE FROM owners WHERE session IN (SELECT number FROM sessions WHERE number = ? AND closed IS NOT NULL)"
OWN_OPEN = (
    f"SELECT {_COLUMNS} FROM sessions s JOIN owners o ON o.session = s.number "  # noqa: S608 -- no value is in it
    "WHERE o.node = ? AND s.closed IS NULL ORDER BY s.number"
)
OTHERS_OPEN = (
    f"SELECT {_COLUMNS}, o.node, n.url, coalesce(n.until > clock_timestamp(), false), "  # noqa: S608
    f"""
    {COUNTED}, coalesce(last.standing, last.outcomes),
    coalesce(last.standing_degraded, last.degraded), last.pending,
    e.told::text, m.them::text, s.state
FROM sessions s LEFT JOIN owners o ON o.session = s.number LEFT JOIN nodes n ON n.node = o.node
LEFT JOIN LATERAL (
    SELECT position, standing, outcomes, standing_degraded, degraded, pending FROM steps
    WHERE session = s.number AND ord = s.decides AND revision IS NULL AND (stream = '' OR number > 0)
    ORDER BY position DESC LIMIT 1
) AS last ON true
LEFT JOIN LATERAL (
    SELECT json_object_agg(property, json_build_array(violations, first)) AS told FROM ({VIOLATIONS}) AS each
) AS e ON true
LEFT JOIN LATERAL (
    SELECT json_agg(json_build_array(name, attached > 0, clock)) AS them FROM monitors WHERE session = s.number
) AS m ON true
WHERE s.closed IS NULL AND (s.id = ?2::text OR (?2::text IS NULL AND o.node IS DISTINCT FROM ?1))
    AND (?3::text IS NULL OR right(s.id, length(?3::text)) = ?3::text)
ORDER BY s.number DESC
"""
)
WHERE_IS = (
    "SELECT o.node, n.url, coalesce(n.until > clock_timestamp(), false) "
    "FROM owners o LEFT JOIN nodes n ON n.node = o.node WHERE o.id = ? "
    "AND NOT EXISTS (SELECT 1 FROM sessions s WHERE s.number = o.session AND s.closed IS NOT NULL)"
)
"""Nobody has a closed session, though a server that was killed may have left its row."""
FORWARDED_OPEN = (
    "SELECT f.own FROM sessions s LEFT JOIN forwarded f ON f.session = s.number WHERE s.id = ? AND s.closed IS NULL"
)
"""Its name at the robot, as far as that is known."""
FORWARDED = """
SELECT f.session, f.gaps, f.ended IS NOT NULL, CASE WHEN abs(extract(epoch FROM clock_timestamp() - o.heard)) > ?1
    THEN to_char(o.heard AT TIME ZONE 'UTC', 'YYYY-MM-DD HH24:MI') END,
    CASE WHEN (to_jsonb(o)->>'behind')::json->>0 = o.writer THEN to_jsonb(o)->>'behind' END
FROM forwarded f LEFT JOIN origins o ON o.origin = f.origin AND o.robot = f.robot
WHERE f.session = ANY(?2::bigint[])
"""
"""Of sessions that robots forward: what is missing, whether nothing more will come of them, since when a robot is
silent that is for some seconds, and what it has still to bring, where there is a column for that.

What was heard so long after now was heard before the database's clock was set back."""
MISSING = "SELECT gaps FROM forwarded WHERE session = ?"
LEFT = """
SELECT s.id FROM forwarded f JOIN sessions s ON s.number = f.session
WHERE f.ended IS NOT NULL AND s.closed IS NULL ORDER BY s.number
"""
"""Open sessions of which nothing more will come: the robot has deleted them."""
NODES = (
    "SELECT node, owner, until <= clock_timestamp(), EXISTS (SELECT 1 FROM owners o WHERE o.node = nodes.node), "
    "until::text FROM nodes WHERE node <> ?"
)
"""The other nodes: whether their lease has run out, whether they have sessions, and until when the lease is."""
TAKE_OVER = """
WITH fenced AS (
    UPDATE nodes SET owner = '', epoch = epoch + 1, until = least(until, clock_timestamp()) WHERE node IN (
        SELECT node FROM nodes WHERE node = ?2 AND (until <= clock_timestamp() OR until::text = ?3::text)
        FOR UPDATE SKIP LOCKED
    ) RETURNING node
)
UPDATE owners SET node = ?1 WHERE node IN (SELECT node FROM fenced)
"""
"""Take the sessions of a node whose lease has run out, or is the one that it has not renewed for too long.

Whoever writes as that node has its row locked. It is not waited for: it may stand still, and the next try is soon.
"""
FORGET_SESSION = [
    "DELETE FROM sessions WHERE number IN (SELECT number FROM sessions WHERE number = ? FOR UPDATE SKIP LOCKED)",
    *(
        f"DELETE FROM {table} WHERE {key} = ?1 AND NOT EXISTS (SELECT 1 FROM sessions WHERE number = ?1)"  # noqa: S608
        for table, key in OF_A_SESSION[:-1]
    ),
]
"""Delete a session unless a robot brings something of it right now, which may take long; it is tried again later."""
TENDED = """
SELECT s.number FROM sessions s LEFT JOIN owners o ON o.session = s.number
WHERE o.node = ?1 OR (
    s.closed IS NOT NULL AND ?1 = (SELECT min(node) FROM nodes WHERE until > clock_timestamp())
)
"""
"""This node's own sessions; what is closed is one node's, so that two never delete the same."""
