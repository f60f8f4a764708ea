"""Episodes: violations of one property that follow each other closely, as one.

They are a function of the rows of an order as they stand, in their sequence, and of nothing else. The time of a row is
the present at it, or the deadline's, and never goes back.

- A row violates where the property is negative at it. It belongs to the episode that is open, or whose last violating
  row was less than `gap` before; else it begins one.
- The property holds: an open episode is open no more, and once `gap` has passed it is over. Another may then begin.
- It is unknown: nothing is said. What is open stays open; what is not is over once `gap` has passed.
- An attempt that is taken back violates for itself alone: what was open stays open, and nothing else is. Where the
  property holds at it, nothing is said.
- What is negative for good stays open until the session is closed, as does what is negative then.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import msgspec

from oracle_server.core.beyond import Beyond
from oracle_server.core.episode import Changes, Episode, EpisodeChange, Following, Worst
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.verdicts import NEGATIVE, Explanation, Outcome, Verdict, json_number

_UNKNOWN = Outcome.UNKNOWN
_BOUNDS = frozenset(("<", "<=", ">", ">="))


class Said(NamedTuple):
    """What a row says of a property: its outcome, how many violations, its robustness, and reasons as plain data.

    `beyond` are the values of its step by which it is negative.
    """

    outcome: Outcome
    violations: int = 0
    robustness: float | None = None
    why: Mapping[str, Any] | None = None
    beyond: Sequence[Beyond] = ()


_NONE: Changes = ()


def follow(
    known: Following, gap: int, time: int, verdicts: Sequence[Verdict], *, instant: bool = False
) -> tuple[Following, Changes]:
    """How episodes stand after a row with these verdicts, at a time (ns), and what it does with them.

    `instant`: it is an attempt that is taken back.
    """
    if not known.episodes and not _begins(verdicts):
        return Following(max(time, known.time)), _NONE
    before = known.episodes or (None,) * len(verdicts)
    pairs = enumerate(zip(before, verdicts, strict=True))
    said = [(i, _said(v)) for i, (episode, v) in pairs if episode is not None or v.outcome in NEGATIVE]
    return follow_said(Following(known.time, before), gap, time, verdicts[0].n, said, instant=instant)


def follow_said(
    known: Following, gap: int, time: int, n: int, said: Iterable[tuple[int, Said]], *, instant: bool = False
) -> tuple[Following, Changes]:
    """The same by what a row says of properties, by their indexes; `n` is the number of its first verdict.

    Nothing need be said of a property that is not negative, and has no episode. `known` has an entry for each.
    """
    time = max(time, known.time)
    after, changes = list(known.episodes), list[EpisodeChange]()
    for i, at in said:
        episode = after[i]
        if episode is not None and not episode.open and time - episode.until >= gap:
            changes.append(EpisodeChange(i, "ends", episode))
            episode = None
        if at.outcome in NEGATIVE:
            found = _violated(episode, at, n + i, time, instant=instant)
            kind = _kind(episode, found, at)
            changes += [EpisodeChange(i, kind, found)] if kind is not None else []
            episode = found
        elif episode is not None and episode.open and at.outcome is not _UNKNOWN and not instant:
            episode = msgspec.structs.replace(episode, open=False)
            changes.append(EpisodeChange(i, "stops", episode))
        after[i] = episode
    return Following(time, tuple(after) if any(after) else ()), tuple(changes)


def _begins(verdicts: Sequence[Verdict]) -> bool:
    """Whether any property becomes negative, as none is before."""
    for verdict in verdicts:  # noqa: SIM110 -- a generator would take three times as long, at each row
        if verdict.explanation is not None and verdict.outcome in NEGATIVE:
            return True
    return False


def _violated(episode: Episode | None, at: Said, n: int, time: int, *, instant: bool) -> Episode:
    """An episode with a row that violates, or one that begins with it."""
    final, worst = at.outcome is Outcome.FALSE, _worst(at, None if episode is None else episode.worst)
    if episode is None:
        return Episode(n, time, n, time, not instant, final, at.violations, worst)
    opened, final = episode.open or not instant, episode.final or final
    return Episode(episode.first, episode.began, n, time, opened, final, episode.count + at.violations, worst)


def _kind(episode: Episode | None, found: Episode, at: Said) -> Literal["begins", "joins"] | None:
    if episode is None:
        return "begins"
    told = at.violations or found.open is not episode.open or found.final is not episode.final
    if not told and found.worst is not None and found.worst is not episode.worst:
        told = episode.worst is None or found.worst.degree != episode.worst.degree
    return "joins" if told else None


def _said(verdict: Verdict) -> Said:
    why = verdict.explanation
    if why is None or verdict.outcome not in NEGATIVE:
        return Said(verdict.outcome, 0, verdict.robustness, None, verdict.beyond)
    return Said(verdict.outcome, violations_of(why), verdict.robustness, why.why, verdict.beyond)


def violations_of(why: Explanation) -> int:
    """How many violations a record tells of: each obligation that was not answered counts."""
    return max(1, why.about_count)


def _worst(at: Said, worst: Worst | None) -> Worst | None:
    """The worst of what a row says and of what was known before it."""
    if at.robustness is not None:
        found = Worst(json_number(at.robustness))
        return found if found.graver(worst) else worst
    for found in () if at.why is None else _misses(at.why.get("reasons") or ()):
        worst = found if found.graver(worst) else worst
    for each in at.beyond:
        found = Worst(None, each.signal, each.op, each.bound, each.value, each.than)
        worst = found if found.graver(worst) else worst
    return worst


def _misses(reasons: Sequence[Mapping[str, Any]]) -> Iterator[Worst]:
    """The values beyond a bound that reasons tell of."""
    for reason in reasons:
        for failing in reason.get("failing") or ():
            value, bound = failing["value"], failing["wanted"]
            if failing["op"] in _BOUNDS and _is_number(value) and _is_number(bound):
                than = failing.get("than")
                yield Worst(None, failing["signal"], failing["op"], bound, value, than)
        yield from _misses(reason.get("reasons") or ())


def _is_number(value: Scalar | None) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
