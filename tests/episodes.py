"""Episodes as a plain list of rows gives them: the rows that violate, and which of them belong together."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from oracle_server.core.episode import Episode, EpisodeChange
from oracle_server.core.spec import Spec
from oracle_server.core.verdicts import NEGATIVE, Judged, Outcome, explain

Key = tuple[int, int]
"""The index of a property, and the number of the verdict that an episode begins with."""


class Line(NamedTuple):
    """What a row says of one property; `instant`: it is an attempt that was taken back."""

    n: int
    time: int
    outcome: Outcome
    violations: int
    instant: bool


def expected(lines: Sequence[Line], gap: int) -> list[Episode]:
    """The episodes of one property, by its rows as they stand."""
    bad = [at for at, line in enumerate(lines) if line.outcome in NEGATIVE]
    groups: list[list[int]] = []
    for at in bad:
        near = groups and lines[at].time - lines[groups[-1][-1]].time < gap
        if near or (groups and is_open(lines[:at])):
            groups[-1].append(at)
        else:
            groups.append([at])
    return [
        Episode(
            first=lines[group[0]].n,
            began=lines[group[0]].time,
            last=lines[group[-1]].n,
            until=lines[group[-1]].time,
            open=group is groups[-1] and is_open(lines),
            final=any(lines[at].outcome is Outcome.FALSE for at in group),
            count=sum(lines[at].violations for at in group),
        )
        for group in groups
    ]


def is_open(lines: Sequence[Line]) -> bool:
    """Whether the last row that says how the property stands says that it is negative."""
    telling = [line for line in lines if line.outcome is not Outcome.UNKNOWN and not line.instant]
    return bool(telling) and telling[-1].outcome in NEGATIVE


def lines_of(rows: Iterable[Judged], spec: Spec, index: int) -> list[Line]:
    """The lines of one property, of the rows of one order as they were judged."""
    lines, present, latest = [], 0, 0
    by_arrival_alone = not any(stream.ordered for stream in spec.streams)
    for row in rows:
        event = row.step.event
        if not event.monitor:
            latest = max(latest, row.step.stamp)
            time = latest
        else:
            attempt = _is_attempt(row, spec)
            now = _moved(present, row, spec, by_arrival_alone=by_arrival_alone)
            latest = time = max(latest, now)
            present = present if attempt else now
        verdict = row.verdicts[index]
        why = verdict.explanation
        count = 0 if why is None else max(1, why.about_count)
        lines.append(Line(verdict.n, time, verdict.outcome, count, bool(event.monitor) and _is_attempt(row, spec)))
    return lines


def _moved(present: int, row: Judged, spec: Spec, *, by_arrival_alone: bool) -> int:
    step, event = row.step, row.step.event
    if step.skipped:
        return present
    if row.order == "arrival":
        return max(present, event.arrived)
    if spec.by_key[event.stream].ordered:
        return max(present, step.time)
    return max(present, min(step.time, event.arrived)) if by_arrival_alone or not present else present


def _is_attempt(row: Judged, spec: Spec) -> bool:
    denied = row.decision is not None and row.decision.choice == "deny"
    stream = spec.by_key[row.step.event.stream]
    return denied and stream.on_deny == "undo" and stream.action == "filter" and not row.step.skipped


class Kept:
    """What a history keeps of episodes, by the changes that rows tell."""

    def __init__(self) -> None:
        self.known: dict[Key, Episode] = {}
        self.texts: dict[Key, str] = {}
        self.over: set[Key] = set()

    def take(self, rows: Iterable[Judged]) -> None:
        for row in rows:
            self._note_ends(row)
            for change in row.episodes:
                key = change.index, change.episode.first
                if change.kind == "goes":
                    del self.known[key]
                elif change.kind == "begins":
                    assert key not in self.known
                    self.known[key] = change.episode
                    self.texts[key] = change.text or self._text(row, change)
                elif change.is_kept:
                    assert key in self.known
                    self.known[key] = change.episode

    def _note_ends(self, row: Judged) -> None:
        """No episode is told to end twice, unless it was told to be otherwise since."""
        ends = [(change.index, change.episode.first) for change in row.episodes if change.kind == "ends"]
        assert len(ends) == len({*ends})
        assert not self.over & {*ends}
        self.over -= {(change.index, change.episode.first) for change in row.episodes}
        self.over |= {*ends}

    @staticmethod
    def _text(row: Judged, change: EpisodeChange) -> str:
        """The explanation of the row that begins an episode, by itself."""
        verdict = row.verdicts[change.index]
        why = explain(row, verdict)
        assert verdict.n == change.episode.first
        assert why is not None
        return why["text"]

    def of(self, index: int) -> list[Episode]:
        found = [episode for (i, _), episode in self.known.items() if i == index]
        return sorted(found, key=lambda episode: (episode.began, episode.first))


def told(episodes: Iterable[Episode]) -> list[Episode]:
    """Episodes without what is not told of those that are open, and without the worst of them."""
    return [
        Episode(e.first, e.began, 0 if e.open else e.last, 0 if e.open else e.until, e.open, e.final, e.count)
        for e in episodes
    ]
