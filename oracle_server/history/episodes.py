"""Episodes as a history keeps them, and questions for them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import msgspec

from oracle_server.core.episode import Episode, EpisodeRecord, Worst
from oracle_server.core.events import Order
from oracle_server.core.judging.judge import Judge
from oracle_server.core.records import ExplanationRecord
from oracle_server.core.verdicts import Judged
from oracle_server.history.records import SessionRecord
from oracle_server.history.whose import ALL, Whose

_WRITTEN = re.compile(r"([0-9]{1,19}):([0-9]{1,19}):([A-Za-z0-9_.-]{1,64}):([0-9]{1,19})")
_BEYOND = 2**63


class StoredEpisode(NamedTuple):
    """An episode of a property of a session, as it is to be kept; `gone`: nothing of it stands any more.

    `text` is the explanation of its first violation, None where that is kept already.
    """

    property: str
    order: Order
    episode: Episode
    text: str | None = None
    gone: bool = False


class Cursor(NamedTuple):
    """Where a page of episodes ends: behind the episode with these, the session by its number."""

    began: int
    session: int
    property: str
    first: int

    def written(self) -> str:
        """As clients give it back."""
        return f"{self.began}:{self.session}:{self.property}:{self.first}"

    @staticmethod
    def parse(text: str) -> Cursor | None:
        """The same, back; None where it is none."""
        found = _WRITTEN.fullmatch(text)
        numbers = [int(found[i]) for i in (1, 2, 4)] if found else [_BEYOND]
        if found is None or max(numbers) >= _BEYOND:
            return None
        return Cursor(numbers[0], numbers[1], found[3], numbers[2])


@dataclass(frozen=True, slots=True)
class EpisodeQuery:
    """Which episodes are wanted: of one session, by its number, or of all those that a sender may see.

    `since` and `until` (ns, both included): those that were not over before, and had begun by then. `order` goes by
    `began`.
    """

    session: int | None = None
    properties: frozenset[str] = frozenset()
    since: int | None = None
    until: int | None = None
    open: bool | None = None
    after: Cursor | None = None
    limit: int = 100
    order: Literal["asc", "desc"] = "asc"
    whose: Whose = ALL

    def asks_of(self, session: SessionRecord) -> bool:
        """Whether episodes of a session are wanted."""
        return (self.session is None or session.number == self.session) and self.whose.has(session)

    def matches(self, stored: StoredEpisode) -> bool:
        """Whether an episode is wanted, as far as that does not depend on its session and the page."""
        episode = stored.episode
        return (
            (not self.properties or stored.property in self.properties)
            and (self.since is None or episode.open or episode.until >= self.since)
            and (self.until is None or episode.began <= self.until)
            and (self.open is None or episode.open is self.open)
        )


Page = tuple[list[EpisodeRecord], Cursor | None]
"""Episodes, and where to go on, None where there are no more."""


def stored_episodes(
    row: Judged, properties: Sequence[str], explanations: Mapping[int, ExplanationRecord]
) -> list[StoredEpisode]:
    """What is to be kept of the episodes of a row's properties; `explanations` are the row's own."""
    found: dict[tuple[int, int], StoredEpisode] = {}
    for change in row.episodes:
        if not change.is_kept:
            continue
        text = change.text
        if text is None and change.kind == "begins" and change.index in explanations:
            text = explanations[change.index]["text"]
        key, gone = (change.index, change.episode.first), change.kind == "goes"
        found[key] = StoredEpisode(properties[change.index], row.order, change.episode, text, gone)
    return [*found.values()]


def going_on(judges: Mapping[Order, Judge], properties: Sequence[str], *, closed: bool = False) -> list[StoredEpisode]:
    """The episodes of a session that may go on, or those that are open, as they end where it is `closed`."""
    known = [
        StoredEpisode(properties[i], order, episode)
        for order, judge in judges.items()
        for i, episode in enumerate(judge.following.episodes)
        if episode is not None and (episode.open or not closed)
    ]
    if not closed:
        return known
    return [each._replace(episode=msgspec.structs.replace(each.episode, open=False)) for each in known]


def told(session: str, spec: str, stored: StoredEpisode) -> EpisodeRecord:
    """The record of an episode of a session, by their ids."""
    episode = stored.episode
    return {
        "session": session,
        "spec": spec,
        "property": stored.property,
        "order": stored.order,
        "first": episode.first,
        "began": episode.began,
        "last": None if episode.open else episode.last,
        "until": None if episode.open else episode.until,
        "open": episode.open,
        "final": episode.final,
        "count": episode.count,
        "worst": None if episode.worst is None else msgspec.to_builtins(episode.worst),
        "explanation": stored.text,
    }


def worst_of(text: str | None) -> Worst | None:
    """The worst of an episode, of its JSON."""
    return None if text is None else msgspec.json.decode(text, type=Worst)


class KeptEpisodes:
    """The episodes of one session in memory."""

    def __init__(self) -> None:
        self._kept: dict[tuple[str, int], StoredEpisode] = {}

    def keep(self, episodes: Iterable[StoredEpisode]) -> None:
        """Keep episodes, in place of what is kept of them."""
        for each in episodes:
            key = each.property, each.episode.first
            known = self._kept.pop(key, None)
            if not each.gone:
                self._kept[key] = each._replace(text=each.text if known is None or known.text is None else known.text)

    def end(self) -> None:
        """Have none of them open: the session is closed."""
        for key, each in self._kept.items():
            self._kept[key] = each._replace(episode=msgspec.structs.replace(each.episode, open=False))

    def forget(self, upto: int) -> None:
        """Forget those that have ended, and whose verdicts are all numbered up to this."""
        self._kept = {k: e for k, e in self._kept.items() if e.episode.open or e.episode.last > upto}

    def matching(self, query: EpisodeQuery) -> list[StoredEpisode]:
        """Those that are wanted, whatever the page."""
        return [each for each in self._kept.values() if query.matches(each)]


def page_of(kept: Iterable[tuple[SessionRecord, KeptEpisodes]], query: EpisodeQuery) -> Page:
    """The page that is wanted of the episodes of sessions."""
    found = [
        (Cursor(e.episode.began, session.number, e.property, e.episode.first), told(session.id, session.spec, e))
        for session, episodes in kept
        if query.asks_of(session)
        for e in episodes.matching(query)
    ]
    descending, after = query.order == "desc", query.after
    found.sort(key=lambda each: each[0], reverse=descending)
    if after is not None:
        found = [each for each in found if (each[0] < after if descending else each[0] > after)]
    page = found[: query.limit]
    return [record for _, record in page], page[-1][0] if len(found) > query.limit else None
