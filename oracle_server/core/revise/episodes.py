"""The episodes of a pass: what there is of them otherwise once the rows behind late events were judged again."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import msgspec

from oracle_server.core.episode import Changes, Episode, EpisodeChange, Following
from oracle_server.core.judging.following import follow
from oracle_server.core.revise.kept import Kept
from oracle_server.core.verdicts import Judged, explain

_Key = tuple[int, int]
"""The index of a property, and the number of the verdict that an episode begins with."""


class Rewritten:
    """The episodes that there were behind a row, and those that there are now."""

    def __init__(self, base: Following, gap: int, stood: Iterable[Kept] = ()) -> None:
        """Begin with how they stood after the last row that is not judged again, and after those that are.

        `gap` (ns) is that of the spec.
        """
        self._before, self._now = _by_key(base), _by_key(base)
        self._went_on = {*self._before}  # those that had not ended, as far as is told
        self._gap = gap
        self._texts: dict[_Key, str] = {}
        self.stood(stood)

    def stood(self, rows: Iterable[Kept]) -> None:
        """Take rows as they stood, in their sequence."""
        for row in rows:
            known = _by_key(row.following)
            self._before |= known
            self._went_on = {*known}

    def stands(self, row: Kept) -> None:
        """Take the next row as it stands."""
        for key, episode in _by_key(row.following).items():
            verdict = row.judged.verdicts[key[0]]
            if verdict.n == episode.first and (why := explain(row.judged, verdict)) is not None:
                self._texts[key] = why["text"]
            self._now[key] = episode

    def told(self, rows: Sequence[Judged], following: Following) -> list[Judged]:
        """The rows of the pass, the last of which has what there is of episodes otherwise, and the others nothing."""
        if not rows or not (self._now or self._before):
            return list(rows)
        plain = [msgspec.structs.replace(row, episodes=()) if row.episodes else row for row in rows]
        plain[-1] = msgspec.structs.replace(plain[-1], episodes=self._changes(_by_key(following)))
        return plain

    def _changes(self, going: Mapping[_Key, Episode]) -> Changes:
        """What is otherwise; those that are not `going` on are over, which is told once of each."""
        gone = [(key, episode) for key, episode in self._before.items() if key not in self._now]
        new = [(key, episode) for key, episode in self._now.items() if key not in self._before]
        changes = [EpisodeChange(key[0], "goes", e, None, self._is_among(new, key, e)) for key, e in gone]
        for key, episode in self._now.items():
            before = self._before.get(key)
            if before is None:
                moved = self._is_among(self._before.items(), key, episode)
                changes.append(EpisodeChange(key[0], "begins", episode, self._texts.get(key), moved))
            elif before != episode or (key in going and key not in self._went_on):  # it may go on again
                changes.append(EpisodeChange(key[0], "restated", episode))
            if key not in going and (before is None or key in self._went_on):
                changes.append(EpisodeChange(key[0], "ends", episode))
        return tuple(changes)

    def _is_among(self, others: Iterable[tuple[_Key, Episode]], key: _Key, episode: Episode) -> bool:
        """Whether others of its property are at the same time as an episode, or less than the gap away."""
        return any(other[0] == key[0] and self._are_near(each, episode) for other, each in others)

    def _are_near(self, one: Episode, other: Episode) -> bool:
        first, second = (one, other) if one.began <= other.began else (other, one)
        return second.began <= first.until or second.began - first.until < self._gap


def rewritten(base: Following, gap: int, rows: Sequence[Kept], unsaid: Sequence[Kept]) -> Rewritten:
    """What rows change that were `unsaid` among others, as of before all of them."""
    found, known = Rewritten(base, gap), base
    new = {id(row) for row in unsaid}
    for row in rows:
        if id(row) not in new:
            time = row.step.stamp if row.is_tick else row.present
            known, _ = follow(known, gap, time, row.judged.verdicts, instant=row.undone)
            found.stood([msgspec.structs.replace(row, following=known)])
        found.stands(row)
    return found


def rename(rows: Iterable[Kept], names: Mapping[int, int]) -> None:
    """Give verdicts other numbers in how episodes stood after rows."""
    for row in rows:
        known = row.following
        found = renamed(known, names)
        if found is not known:
            row.following = found


def renamed(known: Following, names: Mapping[int, int]) -> Following:
    """How episodes stand, with other numbers of verdicts."""
    if all(e is None or not (e.first in names or e.last in names) for e in known.episodes):
        return known
    episodes = [
        e and msgspec.structs.replace(e, first=names.get(e.first, e.first), last=names.get(e.last, e.last))
        for e in known.episodes
    ]
    return msgspec.structs.replace(known, episodes=tuple(episodes))


def _by_key(following: Following) -> dict[_Key, Episode]:
    return {(i, e.first): e for i, e in enumerate(following.episodes) if e is not None}
