"""A session's own trace: its rows, judged again in the sequence in which they were judged."""

from __future__ import annotations

from collections.abc import Container

from oracle_server.core.engine import Answer
from oracle_server.core.errors import TraceError
from oracle_server.core.events import Step
from oracle_server.core.revise.recurring import Recurring, Row
from oracle_server.core.session import Session
from oracle_server.core.verdicts import Judged, Outcome
from oracle_server.replay.recording import Place

_NOT_KEPT = Answer(Outcome.UNKNOWN, "was not asked: a session's trace has no messages, only their signals")


class Again:
    """Judges the rows of a session's trace again, in the sequence in which they were judged."""

    def __init__(self, session: Session, passed_over: Container[int]) -> None:
        """Judge them for a session; rows of the positions that are `passed_over` are of streams that it has not."""
        self._session, self._passed_over = session, passed_over
        self._recurring = None if session.lateness is None else Recurring(session.lateness.judge)
        self._begun = False
        self._last = 0
        self._waiting: set[int] = set()

    def expect(self, position: int) -> None:
        """Note a row that is to be judged. Raises `TraceError` where it has the place of another."""
        if position <= self._last or position in self._waiting:
            raise TraceError(
                f"the recording has step {position} twice, or behind a later one: it is put together of several "
                "recordings, or was changed; give each alone, or use --by to judge the recorded events afresh"
            )
        self._waiting.add(position)

    def judge(self, position: int, place: Place, step: Step) -> list[Judged]:
        """Judge a row that was expected."""
        session = self._session
        before, self._last = self._last, position
        self._waiting.discard(position)
        if place.order not in session.judges:
            raise TraceError(
                f"the first event of the recording was judged by {''.join(session.judges)} alone, and others by "
                f"{place.order}: the recording was taken before all was judged that had come; use --by to judge the "
                "recorded events afresh"
            )
        lacking = next((p for p in range(before + 1, position) if p not in self._passed_over), None)
        if not self._begun and lacking is not None:
            raise TraceError(
                f"the session's first steps are not in the recording, which begins with step {position}, so that its "
                "verdicts would differ; use --by to judge the recorded events afresh"
            )
        if lacking is not None and self._recurring is None:  # else revisions have numbers of their own
            raise TraceError(
                f"steps from {lacking} to before {position} of the session are not in the recording, so that its "
                "verdicts would differ; use --by to judge the recorded events afresh"
            )
        self._begun = True
        bypassed = [i for i, p in enumerate(session.plan.spec.properties) if p.id in place.bypassed]
        for index in session.plan.external:
            session.receive(place.order, {index: place.said.get(session.plan.spec.properties[index].id, _NOT_KEPT)})
        placed = Step(
            step.event, step.signals, step.failed, step.stamp, place.skewed, place.late, place.forced, place.skipped,
            place.released,
        )  # fmt: skip
        if self._recurring is not None:
            session.note_again(placed, place.judged)
            known = Row(position, placed, place.judged, place.place is not None, place.degraded, bypassed)
            return self._recurring.take(known)
        session.judges[place.order].recall(place.degraded, bypassed)
        judged = session.rejudge(place.order, placed, place.judged)
        return [] if judged is None else [judged]

    def finish(self) -> list[Judged]:
        """Judge what was kept to be judged with a later row."""
        return [] if self._recurring is None else self._recurring.finish()
