"""Why an open session is not judged any more: kept with it for those who read it elsewhere, in its `state`."""

from __future__ import annotations

import msgspec

from oracle_server.history.sql.rows import Row, text

NOTE = "UPDATE sessions SET state = ?1 WHERE number = ?2 AND closed IS NULL AND coalesce(state, '') <> coalesce(?1, '')"


def note(session: int, why: str | None) -> Row:
    """The values of `NOTE`; without a reason it is judged."""
    told = None if why is None else text({"trouble": why.encode(errors="replace").decode()})
    return told, session


def noted(state: str | None) -> str | None:
    """Why an open session is not judged any more, by its `state`."""
    why: str | None = None if state is None else msgspec.json.decode(state).get("trouble")
    return why
