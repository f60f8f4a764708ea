"""The `verdicts` frame: the state of a session's properties, as text that adapters show to operators."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime

from oracle_server.core.episode import Episode
from oracle_server.core.judging.asked import unasked
from oracle_server.core.judging.property_state import PropertyState
from oracle_server.core.session import Session
from oracle_server.core.verdicts import Outcome, worst
from oracle_server.wire.frames import EpisodeStanding, Level, PropertyStanding, VerdictsFrame

_WORDING: dict[Outcome, tuple[Level, str]] = {
    Outcome.TRUE: ("ok", "holds for good"),
    Outcome.CURRENTLY_TRUE: ("ok", "holds"),
    Outcome.CURRENTLY_FALSE: ("warn", "does not hold at present"),
    Outcome.FALSE: ("error", "violated for good"),
}


def caveats(core: Session, index: int) -> list[str]:
    """Why the verdicts of a property, by its index, are degraded at present, and since when, for people."""
    return [
        f"{b.text} since {datetime.fromtimestamp(b.since // 10**9, UTC):%F %T} UTC" for b in core.bypasses.of(index)
    ]


_Mark = tuple[Outcome, int, int | None, bool, bool, bool, tuple[str, ...], tuple[object, ...] | None]
"""A property's outcome, its violations and the first one, whether any step could not be judged, whether it waits,
whether nothing was asked of it, its caveats, and its episode."""


class Standing:
    """Follows the properties of the order that decides, from the first monitor on that requests `verdicts` frames."""

    def __init__(self, core: Session) -> None:
        self.committed: VerdictsFrame | None = None
        """The frame as of the last commit; None while no monitor has requested it."""
        self._core = core
        self._judge = next(iter(core.judges.values()))
        self._mark: tuple[_Mark, ...] = ()

    def follow(self, n: int) -> None:
        """Begin to follow; the verdicts up to number `n` are written, if not committed yet."""
        if self.committed is None:
            self._mark, self.committed = self._marked(), self._frame(n)

    def changed(self, n: int) -> VerdictsFrame | None:
        """The frame to send once the verdicts up to `n` are committed, None where nothing has changed."""
        if self.committed is None:
            return None
        before, self._mark = self._mark, self._marked()
        return None if self._mark == before else self._frame(n)

    def ended(self, n: int) -> VerdictsFrame | None:
        """The frame to send once the session has ended: no episode is open any more; None where nobody wants it."""
        if self.committed is None:
            return None
        frame = self._frame(n)
        for state in frame["properties"].values():
            if state["episode"] is not None:
                state["episode"]["open"] = False
        return frame

    @property
    def _states(self) -> Sequence[PropertyState]:
        return self._judge.told.properties

    def _marked(self) -> tuple[_Mark, ...]:
        told = self._judge.told
        episodes = told.following.episodes or (None,) * len(told.properties)
        return tuple(
            [
                (
                    *(state.outcome, state.violations, state.first_violation, state.failures > 0),
                    *(bool(state.pending), state.watch is not None, self._caveats(i, state)),
                    None if episode is None else (episode.first, episode.open, episode.final, episode.count),
                )
                for i, (state, episode) in enumerate(zip(told.properties, episodes, strict=True))
            ]
        )

    def _caveats(self, index: int, state: PropertyState) -> tuple[str, ...]:
        return tuple(caveats(self._core, index)) if state.bypassed else ()

    def _frame(self, n: int) -> VerdictsFrame:
        states = self._states
        episodes = self._judge.told.following.episodes or (None,) * len(states)
        pairs = enumerate(zip(states, episodes, strict=True))
        return {
            "type": "verdicts",
            "n": n,
            "worst": worst(state.outcome for state in states).value,
            "properties": {s.property.id: _standing(s, e, self._caveats(i, s)) for i, (s, e) in pairs},
        }


def _standing(state: PropertyState, episode: Episode | None, caveats: Sequence[str]) -> PropertyStanding:
    level, text = _WORDING.get(state.outcome) or _unknown(state)
    if unasked(state.watch, state.outcome) is not None:
        text = f"{text}; nothing was asked of it yet"
    if state.pending:
        text = f"{text}; answers are awaited"
    if caveats:
        level = "warn" if level == "ok" else level
        text = f"{text}; degraded: {'; '.join(caveats)}"
    return {
        "outcome": state.outcome.value,
        "level": level,
        "text": text,
        "violations": state.violations,
        "first_violation": state.first_violation,
        "first_violation_step": state.first_violation_step,
        "first_violation_at": state.first_violation_at,
        "episode": None if episode is None else _episode(episode),
    }


def _episode(e: Episode) -> EpisodeStanding:
    return {"first": e.first, "began": e.began, "open": e.open, "final": e.final, "count": e.count}


def _unknown(state: PropertyState) -> tuple[Level, str]:
    if state.broken is not None:
        return "error", f"no longer judged: {state.broken}"
    if state.failures:
        return "warn", "could not be judged at the last step"
    return "stale", "not judged yet"
