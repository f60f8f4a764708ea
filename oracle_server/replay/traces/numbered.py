"""The numbers that adapters give the lines of a log: which are missing, and where they begin anew."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from oracle_server.core.units import counted
from oracle_server.replay.recording import Note
from oracle_server.replay.traces.line import Line

_MOST = 1_000
"""The most gaps of a monitor that later lines may still fill."""


@dataclass(slots=True)
class _Gap:
    """Numbers from `first` to before `end`, of which `left` are missing, as was seen at a place."""

    first: int
    end: int
    left: int
    place: str


@dataclass(slots=True)
class Numbers:
    """Whether the lines of a log have all the numbers that were given; a log may begin and end at any."""

    _last: dict[str, int] = field(default_factory=dict)
    _gaps: dict[str, list[_Gap]] = field(default_factory=dict)
    _anew: tuple[str, str] | None = None
    """Where numbers first begin anew, and whose."""
    _times: int = 0
    """How often they do."""
    _judged: bool = False
    """Whether the lines are a session's trace, which has those that it took."""

    def take(self, line: Line, place: str) -> None:
        """Look at the next line. What it tells as lost has numbers, too."""
        last, now = self._last.get(line.monitor), line.seq
        self._judged = self._judged or line.begun is not None
        if self._judged or now is None or line.places or now == last:  # rows of a message have one number
            return
        if last is not None and now < last and self._fills(line.monitor, now):
            return
        if last is not None and now < last:
            self._anew, self._times = self._anew or (place, line.monitor), self._times + 1
        elif last is not None and now - last - 1 > line.lost:
            gaps = self._gaps.setdefault(line.monitor, [])
            if len(gaps) < _MOST:
                gaps.append(_Gap(last + 1, now, now - last - 1 - line.lost, place))
        self._last[line.monitor] = now

    def _fills(self, monitor: str, number: int) -> bool:
        """Whether a line only comes later than its number says."""
        for gap in reversed(self._gaps.get(monitor, [])):
            if gap.first <= number < gap.end and gap.left:
                gap.left -= 1
                return True
        return False

    def notes(self) -> Iterator[Note]:
        """What is to be said of the log, of each monitor once."""
        for monitor, gaps in self._gaps.items():
            missing = [gap for gap in gaps if gap.left]
            if missing:
                first, total = missing[0], sum(gap.left for gap in missing)
                what = f"{first.place}: {counted(first.left, 'event')} of '{monitor}' missing before it"
                yield Note(f"{what}, by the numbers of the lines (`seq`); {total} in all", doubt=True)
        if self._anew is not None:
            place, monitor = self._anew
            what = f"{place}: the numbers (`seq`) of '{monitor}' begin anew ({counted(self._times, 'time')} in all)"
            yield Note(f"{what}, as where its adapter was started again: what came in between is not in the log")
