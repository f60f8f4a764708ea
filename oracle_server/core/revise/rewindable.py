"""A judge that can go back to how it stood after any of the rows that it keeps."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

from oracle_server.core.derived.journal import Undo
from oracle_server.core.engine import Engine, rewindable
from oracle_server.core.events import Order, Step
from oracle_server.core.judging.judge import Judge
from oracle_server.core.judging.recent import SIZE, Recent
from oracle_server.core.plan import Plan, StreamPlan
from oracle_server.core.revise.episodes import Rewritten
from oracle_server.core.revise.finality import RevisableState, Stand
from oracle_server.core.revise.kept import MOST, Keeping, Kept, Point
from oracle_server.core.spec import Property
from oracle_server.core.verdicts import Judged

_FORGET_AFTER = 64
"""Rows after which those that need not be kept any more are forgotten: many at once cost less."""


class RewindableJudge(Judge):
    """Keeps the rows of a horizon, and stands as after the last one of them when some are taken away."""

    def __init__(self, plan: Plan, engines: Sequence[Engine], order: Order, numbers: Iterator[int]) -> None:
        """Judge with one fresh engine a property, each of which can go back; verdicts are numbered from `numbers`."""
        self.horizon = plan.spec.ordering.horizon
        self._changed: list[RevisableState] = []
        """The properties that may stand otherwise than after the last row that is kept."""
        super().__init__(plan, engines, order, numbers)
        self._states = [state for state in self.properties if isinstance(state, RevisableState)]
        self._engines = [rewindable(engine) for engine in engines]
        self._recent = Recent(SIZE, spare=MOST)
        self._width, self._derives = len(engines), bool(plan.spec.derive)
        self.keeping = Keeping(self.horizon, self._point())
        self.newest = 0
        """The time of the newest step (ns)."""
        self._position = 0  # of the last row that is no revision
        self._not_before = 0
        """What is judged again without being in order is judged at no earlier time (ns) than it was."""
        self._added = 0  # rows, since others were forgotten
        self._rewritten: Rewritten | None = None  # of the pass that goes on
        self.noting: Callable[[Kept], None] | None = None
        """Who is told of each row that is kept, whenever it was judged; None where nobody is."""
        for engine in self._engines:
            engine.record()
        self._derived.record()

    def remember(self, steps: int, effort: int) -> None:
        """See `Telling.remember`."""
        self._recent = Recent(steps, effort, MOST)

    def _state(self, prop: Property, engine: Engine, grace: int) -> RevisableState:
        return RevisableState(prop, engine, grace=grace, horizon=self.horizon, changed=self._changed)

    def _stand_as_last(self, noted: Iterable[Sequence[Undo]] = ()) -> None:
        """Stand as after the last row that is kept; `noted` are those of the rows behind it, the last one first."""
        self._derived.rewind(noted)
        point = self.keeping.last
        self._recent.remove(self.counters.steps - point.steps)
        for state, engine, stand in zip(self._states, self._engines, point.properties, strict=True):
            if state.broken is None and state.is_asked:
                engine.rewind(point.steps, point.present, point.before)
            state.put(stand)
        self.present, self._ticked, self._outdated = point.present, point.ticked, point.outdated
        self.counters.steps, self.following = point.steps, point.following
        self._held.go_to(point.held)

    def _keep(self, judged: Judged, key: int, level: int, *, undone: bool = False, old: Kept | None = None) -> None:
        """Keep a row that was judged; `old` is how it was kept before where it was judged again."""
        keeping, present, steps = self.keeping, self.present, self.counters.steps
        last = keeping.last
        before = last.present if steps > last.steps else last.before
        stands = self._stand() if self._changed else last.properties
        if old is None:
            position, preceding = (judged.verdicts[0].n - 1) // self._width + 1, self._position
            self._position = position
            key = key if key > keeping.key else keeping.key  # noqa: FURB136 -- as below
        else:
            position, preceding = old.position, old.preceding
        if present > self.newest:  # noqa: PLR1730 -- `max` takes longer than all else here
            self.newest = present
        noted = self._derived.noted() if self._derives else ()
        row = Kept(
            present, before, self._ticked, self._outdated, steps, self._held.version, stands, self.following,
            judged, key, level, position, preceding, undone, noted,
        )  # fmt: skip
        keeping.add(row, self.newest)
        if self._rewritten is not None:
            self._rewritten.stands(row)
        if self.noting is not None:
            self.noting(row)
        self._added += 1
        if self._added >= _FORGET_AFTER:
            self.forget()

    def forget(self) -> None:
        """Keep no rows, and nothing in the engines, for events that are older than the horizon."""
        self._added = 0
        self.keeping.forget(self.newest)
        self._recent.forget(len(self.keeping))
        base = self.keeping.base
        for state, engine in zip(self._states, self._engines, strict=True):
            if state.broken is None:
                engine.forget(base.steps, base.present)

    def _point(self, before: int = 0) -> Point:
        """How the judge stands where no row is kept; `before` is the time of the step before the last one (ns)."""
        steps, stands = self.counters.steps, self._stand()
        return Point(
            self.present, before, self._ticked, self._outdated, steps, self._held.version, stands, self.following
        )

    def _stand(self) -> tuple[Stand, ...]:
        """How its properties stand, which have not changed since."""
        self._changed.clear()
        return tuple([state.stand() for state in self._states])

    def _position_of(self, judged: Judged) -> int:
        return (judged.verdicts[0].n - 1) // self._width + 1

    def _move_on(self, step: Step, stream: StreamPlan) -> None:
        if stream.spec.ordered and not self._not_before:
            self.present = max(self.present, step.time)
        else:
            super()._move_on(step, stream)
            self.present = max(self.present, self._not_before)
