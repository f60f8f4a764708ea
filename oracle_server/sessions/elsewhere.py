"""Sessions that other servers over the same history have: who asks for one here is told where it is, and how it stands.

Nothing of them is judged here. How they stand is read from what is committed.
"""

from __future__ import annotations

from typing import NamedTuple

from oracle_server.core.errors import OracleError
from oracle_server.history.origins import origin_of, own_name
from oracle_server.history.port import History
from oracle_server.history.records import Document, Elsewhere, OtherSession, SessionRecord
from oracle_server.sessions.committed import first_place, property_state
from oracle_server.sessions.last import standing
from oracle_server.sessions.unrestored import bare
from oracle_server.wire.errors import WireError


class OtherServerError(OracleError):
    """A session that another server has, which alone can do what is asked for."""


class Left(NamedTuple):
    """A session that no server has any more, and how it stands."""

    record: SessionRecord
    state: Document


class Others:
    """The sessions of other servers."""

    def __init__(self, history: History) -> None:
        self._history = history

    async def has(self, name: str) -> bool:
        """Whether a session is open that this server does not have. Raises `HistoryError`."""
        return await self._history.elsewhere(name) is not None

    async def moved(self, name: str, *, known: bool) -> WireError | None:
        """What who wants to join a session is told, None where no other server has it; `known`: it has a record.

        It names the other one's address, if it is known. A robot's session is never joined here. A session of this
        server that has no record yet is one that is being opened. Raises `HistoryError`.
        """
        place = await self._history.elsewhere(name)
        if (origin := origin_of(name)) is not None:
            why = f"'{name}' names a session of '{origin}', which is only read here: attach to the server there, where "
            return WireError("bad_attach", f"{why}it is '{_own(name, place)}'", fatal=True)
        if place is None or (place.here and not known):
            return None
        url = place.url if place.lasting and not place.here else None
        return WireError("moved", f"session '{name}' is {_where(place)}", fatal=True, url=url)

    async def demand_own(self, name: str) -> None:
        """Raise `OtherServerError` where another server has a session."""
        place = await self._history.elsewhere(name)
        if place is not None and not place.here:
            if (origin := origin_of(name)) is not None:
                where = f"is forwarded from '{origin}': only the server there can do this, where it is"
                raise OtherServerError(f"session '{name}' {where} '{_own(name, place)}'")
            raise OtherServerError(f"session '{name}' is {_where(place)}; only that one can do this")

    async def left(self, name: str) -> Left | None:
        """A session that robots have forwarded, and that may be closed here, since its robot is not heard or lost it.

        None where nobody else has it. Raises `OtherServerError` where another server has a session.
        """
        found = await self._history.open_elsewhere(name) if origin_of(name) is not None else []
        if not found or not found[0].may_end:
            await self.demand_own(name)
            return None
        return Left(found[0].record, await self._told(found[0]))

    async def state(self, name: str) -> Document | None:
        """How a session stands that another server has, by what is committed; None where none has it."""
        found = await self._history.open_elsewhere(name)
        return await self._told(found[0]) if found else None

    async def states(self, origin: str | None = None) -> list[Document]:
        """How all of them stand, or those that are forwarded from a robot, the newest first.

        Where a property was violated first is left out: it is a look for each.
        """
        return [_state(await self._revised(other)) for other in await self._history.open_elsewhere(origin=origin)]

    async def _told(self, other: OtherSession) -> Document:
        state = _state(await self._revised(other))
        for prop in state["properties"]:
            prop.update(await first_place(self._history, other.record, prop["first_violation"]))
        return state

    async def _revised(self, other: OtherSession) -> OtherSession:
        """A session's properties by more than its last row, where late events may put verdicts right."""
        if "revise" not in other.record.text:
            return other
        return other._replace(properties=await standing(self._history, other.record, other.properties))


def _state(other: OtherSession) -> Document:
    """With the keys of an open session's, and its server's name; what only that one knows is None, 0 or left out."""
    record, place = other.record, other.place
    is_judged = place.lasting and other.unjudged is None
    there = [name for name, attached, _ in other.monitors if attached and is_judged]
    origin, trouble = origin_of(record.id), other.trouble
    if origin is None and place.node and not place.lasting:
        trouble = f"its server '{place.node}' does not answer; another one takes over"
    return bare(record) | {
        "live": bool(there),
        "clock": next((clock for _, _, clock in other.monitors), None),
        "node": (place.node or None) if origin is None else None,
        "trouble": "; ".join(filter(None, (other.unjudged, trouble))) or None,
        "monitors": [_monitor(name, attached, name in there) for name, attached, _ in other.monitors],
        "properties": [property_state(stands, record.decides) for stands in other.properties],
        "counters": bare(record)["counters"] | {"steps": other.steps},
    }


def _monitor(name: str, attached: bool, connected: bool) -> Document:
    return {"name": name, "attached": attached, "connected": connected, "next": None, "credit": None, "streams": []}


def _own(name: str, place: Elsewhere | None) -> str:
    """What a robot's session is called there: at the centre, another one may have had its name before."""
    return (place and place.own) or own_name(name)


def _where(place: Elsewhere) -> str:
    """In words, and what to do."""
    if place.beside:
        at = f"at another process here ({place.node})" if place.lasting else "at no process at present"
        return f"{at}, and this server only reads"
    if place.here:
        return "just being taken over by this server; try again"
    if not place.lasting:
        return f"at the server '{place.node}', which does not answer; another one takes over: try again"
    if place.url is None:
        return f"at the server '{place.node}', which does not tell its address (ORACLE_ADVERTISE)"
    return f"at the server '{place.node}', {place.url}"
