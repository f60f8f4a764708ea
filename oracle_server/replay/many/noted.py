"""What is noted of the steps of one replay for its rows, and these rows."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from typing import Any

from oracle_server.core.errors import one_line
from oracle_server.core.events import Order
from oracle_server.core.kinds import TICK
from oracle_server.core.spec import Property, Spec
from oracle_server.core.verdicts import Judged, explain
from oracle_server.replay.conclusion import conclude
from oracle_server.replay.run import Replay
from oracle_server.replay.settling import Settled

_NOTHING = {"outcome": "unknown"} | dict.fromkeys(("violations", "episodes", "unknown", "late", "skipped"), 0)
"""What a recording without any event comes to."""
_Of = tuple[Order, str]
"""An order, and the id of a property."""


class Noted:
    """The first violation of each property, its least robustness, and the times of the events."""

    def __init__(self, spec: Spec) -> None:
        self.first_at: int | None = None
        self.last_at: int | None = None
        self._texts: dict[_Of, str] = {}
        self._least: dict[_Of, float] = {}
        self._measures = any(prop.numeric for prop in spec.properties)

    def note(self, judged: Judged) -> None:
        """Note a step as it stands."""
        step = judged.step
        if step.event.stream.kind != TICK:
            if self.first_at is None or step.stamp < self.first_at:
                self.first_at = step.stamp
            if self.last_at is None or step.stamp > self.last_at:
                self.last_at = step.stamp
        if isinstance(judged, Settled):
            self._note_told(judged)
            return
        for verdict in judged.verdicts:
            if verdict.explanation is not None and (judged.order, verdict.property) not in self._texts:
                why = explain(judged, verdict)
                self._texts[judged.order, verdict.property] = why["text"] if why else ""
            if self._measures and verdict.robustness is not None:
                self._measure((judged.order, verdict.property), verdict.robustness)

    def _note_told(self, judged: Settled) -> None:
        for row in judged.told:
            of = (judged.order, row["property"])
            if row["violation"] and of not in self._texts:
                self._texts[of] = row["explanation"]["text"] if row["explanation"] else ""
            if isinstance(row["robustness"], float | int):
                self._measure(of, row["robustness"])

    def _measure(self, of: _Of, robustness: float) -> None:
        if math.isfinite(robustness) and robustness < self._least.get(of, math.inf):
            self._least[of] = robustness

    def columns(self, replay: Replay) -> Iterator[dict[str, Any]]:
        """The columns of a replay that has ended: first those of the first property, in each order."""
        end = conclude(replay)
        lines = (*end.doubts, *end.warnings, *end.remarks)
        shared: dict[str, Any] = {
            "events": replay.events,
            "first_at": self.first_at,
            "last_at": self.last_at,
            "notes": "; ".join(map(one_line, lines)) or None,
            "exit": end.status,
            "error": "; ".join(map(one_line, end.unusable)) or None,
            "error_kind": "recording" if end.unusable else None,
        }
        judges = replay.session.judges if replay.session is not None else {}
        episodes = Counter((each.order, each.property) for each in replay.episodes.all())
        for index, prop in enumerate(replay.spec.properties):
            reason = {"unjudged": one_line(end.unjudged[prop.id]) if prop.id in end.unjudged else None}
            if not judges:
                yield shared | reason | _NOTHING | {"property": prop.id}
            for order in judges:
                yield (
                    shared
                    | reason
                    | self._standing(replay, index, prop, order)
                    | {"episodes": episodes[order, prop.id]}
                )

    def _standing(self, replay: Replay, index: int, prop: Property, order: Order) -> dict[str, Any]:
        assert replay.session is not None  # noqa: S101 -- it has judges
        judge = replay.session.judges[order]
        state = judge.properties[index]
        return {
            "property": prop.id,
            "order": order,
            "outcome": state.outcome.value,
            "violations": state.violations,
            "first_violation_step": state.first_violation_step,
            "first_violation_at": state.first_violation_at,
            "explanation": self._texts.get((order, prop.id)),
            "robustness": self._least.get((order, prop.id)),
            "unknown": state.failures,
            "pending": state.pending,
            "late": judge.counters.late,
            "skipped": judge.counters.skipped,
        }
