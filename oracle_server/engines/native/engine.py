"""The engine around the nodes of a formula: it steps them, and takes steps back."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from operator import attrgetter
from typing import Any

from oracle_server.core.atoms import Matches
from oracle_server.core.errors import EngineError
from oracle_server.core.explanation import Why
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.tree import Formula
from oracle_server.core.lost import Lost
from oracle_server.core.past import NO_PAST, Past
from oracle_server.core.verdicts import Outcome
from oracle_server.engines.native.build import build
from oracle_server.engines.native.explain import explain
from oracle_server.engines.native.nodes import ABSENT
from oracle_server.engines.native.timeline import Frame, Journal, Timeline
from oracle_server.engines.native.unanswered import explain_obligations
from oracle_server.engines.native.waiting import never

_NEVER = 2**63
_current = attrgetter("current")
FORMAT = 3
"""The number of the form that snapshots have."""


class NativeEngine:
    """The state of one formula in one session."""

    def __init__(self, formula: Formula, time: Time = "steps", share: float = 1) -> None:
        """`share` is the part of an engine's cost limit that this one may use: many engines share it."""
        self._formula, self._time = formula, time
        self._timed = time == "seconds"
        self._timeline = Timeline(timed=self._timed, share=share)
        network = self._network = build(formula, self._timeline)
        self._atoms, self._operators = network.atoms, network.operators
        self._plain = [atom for _, atom in self._atoms]
        self.owed = network.obligations
        """What it waits for; None where its formula only looks back."""
        (self._holds,), (self._settled,) = network.root.at, network.root.settled
        self._can_settle = any(network.root.can_settle[0](frozenset()))
        self._marks: list[tuple[int, int, int]] = []
        """Where in the journal the frame of each open mark is, the time of that step, and of the one before it."""
        self._records = False
        """Whether the journal has a frame for each of the last steps at which something changed."""
        self._held = False
        """Whether an atom may have held at the last step that its nodes took."""
        self._steps = 0
        self._due = 0
        """When something may change although no atom does: a step's number, or nanoseconds."""
        self._last: Outcome = Outcome.UNKNOWN

    def step(self, time: int, matches: Matches) -> Outcome:
        """Judge the next step; see `Engine.step`."""
        now = time if self._timed else self._steps + 1
        silent = matches.count(None) == len(matches)
        if silent and now < self._due:
            self._steps += 1
            self._timeline.move(now)
            return self._last
        if self._records and not self._marks:
            self._note_frame()
        self._steps += 1
        self._timeline.move(now)
        for place, atom in self._atoms:
            match = matches[place]
            if match is not None or not atom.idle:
                atom.take(match)
        if self.owed is not None:
            self.owed.number = self._steps
        for operator in self._operators:
            operator.step()
        self._timeline.first = False
        self._held = not silent
        self._due = self._next_due() if silent else 0
        self._last = self._outcome()
        return self._last

    def _outcome(self) -> Outcome:
        holds = self._holds(())
        if self._can_settle and self._settled(()) is holds:
            return Outcome.TRUE if holds else Outcome.FALSE
        return Outcome.CURRENTLY_TRUE if holds else Outcome.CURRENTLY_FALSE

    def next_deadline(self, after: int) -> int | None:
        """The first time (ns) later than `after` at which the outcome may change without a step, None for never."""
        if not self._timed or self._timeline.first:
            return None
        if self.owed is not None:  # what its parts are at a time without a step is asked by nobody
            return self.owed.next_deadline(after)
        deadlines = [d for operator in self._operators if (d := operator.next_deadline(after)) is not None]
        return min(deadlines, default=None)

    def lose(self, lost: Collection[Lost]) -> None:
        """For the next step alone: these atoms, by their places, can't be judged; see `Owing`."""
        assert self.owed is not None  # noqa: S101 -- it waits for something
        self.owed.lose(lost)
        if lost:
            self._due = 0

    def decide(self, time: int, enough: Callable[[], bool]) -> bool:
        """Before `pass_time`: decide a part of what it will; see `Owing`."""
        assert self.owed is not None  # noqa: S101 -- it waits for something
        if self.owed.passing is None:
            self.mark()
            self.owed.number = self._steps
        return self.owed.decide(time, enough)

    def pass_time(self, time: int) -> None:
        """Time (ns) has come without a step; see `Owing`."""
        assert self.owed is not None  # noqa: S101 -- it waits for something
        self.decide(time, never)
        self.owed.passing = None
        if self.owed.closed:
            self.keep()
        else:  # it is recorded nowhere, so that a restored session knows nothing of it
            self.back()
            self.owed.forget()
        self._due = 0

    def count_from(self, time: int) -> None:
        """For what was asked the next step counts at no time (ns) before this; 0 where it counts at its own."""
        self._timeline.reached = time
        if time:
            self._due = 0

    def end(self) -> None:
        """Nothing will come any more; see `Owing`."""
        assert self.owed is not None  # noqa: S101 -- it waits for something
        self.owed.end()

    @property
    def work(self) -> int:
        """What the last step cost, in values that were looked at."""
        return self._timeline.work

    def allow(self, work: int) -> None:
        """Let it look at so many values for a step; see `Bounded.allow`."""
        self._timeline.allowed = work

    def explain(self, past: Past = NO_PAST) -> Why:
        """Why the formula holds, or does not, at the last step; see `Explaining.explain`."""
        if self.owed is not None:
            return explain_obligations(self._formula, self._network, self.owed, self._time, self._steps, past)
        return explain(self._formula, self._network, self._time, self._steps, past)

    def snapshot(self) -> dict[str, Any]:
        """All that later verdicts depend on, as plain data that JSON can represent."""
        nodes = [*self._plain, *self._operators]
        return {
            "format": FORMAT,
            "clock": self._timeline.snapshot(),
            "nodes": [node.snapshot() for node in nodes],
            "steps": self._steps,
            "due": self._due,
            "last": self._last.value,
        }

    def restore(self, data: Mapping[str, Any]) -> None:
        """Continue from a snapshot of the same formula, before the first step.

        Raises `EngineError` where it was taken by a version that keeps other things.
        """
        if data.get("format") != FORMAT:
            raise EngineError(f"a snapshot of format {data.get('format')}, and this version reads {FORMAT}")
        self._timeline.restore(data["clock"])
        nodes = [*self._plain, *self._operators]
        for node, state in zip(nodes, data["nodes"], strict=True):
            node.restore(state)
        self._held = True
        self._steps, self._due, self._last = data["steps"], data["due"], Outcome(data["last"])

    def mark(self) -> None:
        """Note all changes from now on, until `back` or `keep`; marks can be nested."""
        if self._timeline.journal is None:
            self._timeline.journal = []
        self._marks.append((len(self._timeline.journal), self._timeline.now, self._timeline.before))
        self._note_frame()

    def back(self) -> None:
        """Take back all steps since the last mark."""
        begin, now, before = self._marks.pop()
        frame = self._undo(begin)
        self._timeline.place(now, before, self._steps - frame.steps)
        self._stand_as(frame)
        self._close()

    def keep(self) -> None:
        """Keep the steps since the last mark; a recording engine takes them back together."""
        self._marks.pop()
        self._close()

    def record(self) -> None:
        """From now on, keep what is needed to go back."""
        self._records, self._timeline.journal = True, []

    def rewind(self, step: int, time: int, before: int) -> None:
        """Go back to a step; see `Rewindable.rewind`."""
        journal, begin = self._journal, None
        for place in range(len(journal) - 1, -1, -1):
            entry = journal[place]
            if type(entry) is Frame:
                if entry.steps < step:
                    break
                begin = place
        frame = None if begin is None else self._undo(begin)
        self._timeline.place(*((time, before) if self._timed else (step, max(0, step - 1))), self._steps - step)
        if frame is not None:
            self._stand_as(frame)
        self._steps = step

    def forget(self, step: int, time: int) -> None:
        """Keep no more than is needed to go back to a step."""
        gone = 0
        for entry in self._journal:
            if type(entry) is Frame and entry.steps >= step:
                break
            gone += 1
        del self._journal[:gone]
        self._timeline.trim(time if self._timed else step)

    @property
    def _journal(self) -> Journal:
        """The journal of its timeline, while there is one."""
        assert self._timeline.journal is not None  # noqa: S101 -- a mark is open, or it was told to record
        return self._timeline.journal

    def _note_frame(self) -> None:
        """Note how it stands."""
        line, journal = self._timeline, self._timeline.journal
        assert journal is not None  # noqa: S101 -- as in `_journal`, without a call at most steps
        current = list(map(_current, self._plain)) if self._held else None
        journal.append(Frame(self._steps, self._due, self._last, line.first, line.work, line.debt, current))

    def _undo(self, begin: int) -> Frame:
        """Take back its nodes' changes since the frame at a place of the journal, the last one first."""
        frame, *undone = self._journal[begin:]
        assert isinstance(frame, Frame)  # noqa: S101 -- there is one at this place
        del self._journal[begin:]
        for undo in reversed(undone):
            if not isinstance(undo, Frame):
                undo()
        return frame

    def _stand_as(self, frame: Frame) -> None:
        """Stand as it did, where its nodes do and its timeline is at that step."""
        self._steps, self._due, self._last = frame.steps, frame.due, frame.last
        self._timeline.first, self._timeline.work, self._timeline.debt = frame.first, frame.work, frame.debt
        self._held = frame.current is not None
        for atom, current in zip(self._plain, frame.current or [ABSENT] * len(self._plain), strict=True):
            atom.current = current

    def _close(self) -> None:
        """Note no more changes where no mark is open, unless it records them."""
        if not self._marks and not self._records:
            self._timeline.journal = None

    def _next_due(self) -> int:
        deadlines = [due for operator in self._operators if (due := operator.due()) is not None]
        return min(deadlines, default=_NEVER)
