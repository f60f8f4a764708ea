"""The episodes of a session whose snapshot an older version took, which knew of none: those that its history has."""

from __future__ import annotations

from collections.abc import Mapping

from oracle_server.core.episode import Episode, Following
from oracle_server.core.session import Session
from oracle_server.history.episodes import EpisodeQuery
from oracle_server.history.port import Reading
from oracle_server.history.records import SnapshotRecord


def knows_episodes(snapshot: SnapshotRecord | None) -> bool:
    """Whether a snapshot has the episodes that may go on; one that can't be used has nothing to go on."""
    data = snapshot.data if snapshot is not None else None
    if not isinstance(data, dict) or not {"judges", "revising"} & data.keys():
        return True
    judges = [*data.get("judges", {}).values(), *([data["revising"]["judge"]] if "revising" in data else [])]
    return all("episodes" in judge for judge in judges)


async def find_episodes(history: Reading, session: int, core: Session) -> None:
    """Go on with a session's episodes that the history has as open."""
    page, _ = await history.episodes(EpisodeQuery(session=session, open=True, limit=1000))
    places = {prop.id: i for i, prop in enumerate(core.plan.spec.properties)}
    for order, judge in core.judges.items():
        known: Mapping[int, Episode] = {
            places[e["property"]]: Episode(e["first"], e["began"], e["first"], e["began"], True, e["final"], e["count"])
            for e in page
            if e["order"] == order and e["property"] in places
        }
        if known and not judge.following.episodes:
            judge.following = Following(judge.present, tuple([known.get(i) for i in range(len(places))]))
