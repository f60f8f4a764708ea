"""Why a verdict of the history is as it is: the session is judged again up to it, with more in mind than live."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import msgspec

from oracle_server.core.atoms import Matches
from oracle_server.core.engine import Engine
from oracle_server.core.errors import EngineError, OracleError
from oracle_server.core.events import Order
from oracle_server.core.plan import Plan, judged_by, plan
from oracle_server.core.session import Session, orders
from oracle_server.core.spec import Property
from oracle_server.core.verdicts import Outcome, explain
from oracle_server.engines.native import NativeEngine
from oracle_server.history.sqlite.schema import LETTERS, OUTCOMES, STEP_COLUMNS, Row, records_of, step_of
from oracle_server.history.sqlite.store import Store
from oracle_server.specfiles.load import parse_spec

_NATIVE = frozenset({"auto", "native", "both", "reelay"})
_REMEMBERED = 20_000
_EFFORT = 2_000_000
_LONG = 50_000
"""Steps that are always judged again from the first one; of more, from the snapshot where there is one before."""
_GONE = "what came before it is not kept any more, so that it can't be judged again"
_FINAL = LETTERS[Outcome.TRUE], LETTERS[Outcome.FALSE]
_COLUMNS = ",".join(STEP_COLUMNS)
_POSITION = STEP_COLUMNS.index("position")


class NoExplanationError(OracleError):
    """A verdict can't be explained."""


def explained(
    store: Store, session: int, n: int, given_up: Callable[[], bool] = lambda: False
) -> dict[str, Any] | None:
    """The record number `n` of a session with its explanation, None where there is no such record.

    A verdict that had been final before is explained by the step that made it so. Call it off the event loop: it takes
    as long as judging all that came before, or until `given_up`, which is looked at before each step. Raises
    `NoExplanationError`.
    """
    found = store.read("SELECT id, text, asked FROM sessions WHERE number = ?", (session,))
    if not found:
        return None
    name, text, by = found[0]
    ready = judged_by(plan(parse_spec(text, name).spec), by)
    properties = ready.spec.properties
    before, index = divmod(n - 1, len(properties))
    rows = store.read(f"SELECT {_COLUMNS} FROM steps WHERE session = ? AND position = ?", (session, before + 1))  # noqa: S608
    if not rows:
        return None
    record = records_of(rows[0], [p.id for p in properties])[index]
    if properties[index].engine not in _NATIVE and record["explanation"] is not None:
        return record
    _demand_explicable(record, properties[index], rows[0])
    undoing = [key.name for key, stream in ready.streams.items() if stream.undoes]
    target = _decided(store, session, record, properties[index], before + 1, index, undoing)
    explaining = _Explaining(store, session, ready, index, given_up)
    return {**record, "explanation": explaining.explain(record["order"], target)}


def _demand_explicable(record: dict[str, Any], prop: Property, row: Row) -> None:
    if prop.engine not in _NATIVE:
        raise NoExplanationError(f"the engine of '{prop.id}' can't say why its verdicts are as they are")
    if record["step"] is None and record["kind"] != "tick":
        raise NoExplanationError(f"verdict {record['n']} is no judgement: its event came late, or could not be kept")
    if record["outcome"] == Outcome.UNKNOWN:
        failed = ", ".join(msgspec.json.decode(row[STEP_COLUMNS.index("failed")]))
        reason = f"computing failed for {failed}" if failed else "the engine failed"
        raise NoExplanationError(f"verdict {record['n']} is no judgement: {reason}")


def _decided(
    store: Store, session: int, record: dict[str, Any], prop: Property, position: int, index: int, undoing: list[str]
) -> int:
    """The position of the step that decides a verdict: that made it final, or the last one that counts.

    Denied attempts on the streams `undoing` count for themselves alone.
    """
    same = "session = ? AND position <= ? AND ord = ?"
    values = (session, position, record["order"])
    final = f"SELECT min(position) FROM steps WHERE {same} AND substr(outcomes, ?, 1) IN (?, ?)"  # noqa: S608
    ((found,),) = store.read(final, (*values, index + 1, *_FINAL))
    if found is None and record["kind"] == "tick" and prop.time == "steps":  # ticks say nothing of it
        undone = f"decision IS 'deny' AND kind != 'response' AND stream IN ({','.join('?' * len(undoing))})"
        last = f"SELECT max(position) FROM steps WHERE {same} AND number IS NOT NULL AND NOT ({undone})"  # noqa: S608
        ((found,),) = store.read(last, (*values, *undoing))
    return found or position


class _Explaining:
    """A session judged again, one property of it by the native engine."""

    def __init__(self, store: Store, session: int, ready: Plan, index: int, given_up: Callable[[], bool]) -> None:
        self._store, self._session, self._plan, self._index = store, session, ready, index
        self._given_up = given_up
        self._recorded: list[tuple[int, _Recorded]] = []

    def explain(self, order: Order, target: int) -> dict[str, Any] | None:
        """Why the property stands as it does at the step at position `target`."""
        core, start = self._begin(target)
        state = core.judges[order].properties[self._index]
        for position, row in enumerate(self._rows(start, target), start + 1):
            if row[_POSITION] != position:  # they went since their beginning was looked for
                raise NoExplanationError(_GONE)
            if self._given_up():
                raise NoExplanationError("nobody waits for it any more")
            step_order, step, at = step_of(row)
            letters = row[STEP_COLUMNS.index("outcomes")]
            for place, engine in self._recorded:
                engine.outcome = OUTCOMES[letters[place]]
            state.asked = position == target
            judged = core.rejudge(step_order, step, at)
            time.sleep(0)  # the event loop needs the interpreter more
            if state.asked:
                return None if judged is None else explain(judged, judged.verdicts[self._index])
        raise NoExplanationError(_GONE)

    def _begin(self, target: int) -> tuple[Session, int]:
        """A session, fresh or out of the snapshot, and the position of its last step."""
        core = self._fresh()
        ((first,),) = self._store.read("SELECT min(position) FROM steps WHERE session = ?", (self._session,))
        if first is None:
            raise NoExplanationError(_GONE)
        if target > _LONG or first > 1:
            sql = "SELECT position, data FROM snapshots WHERE session = ? AND position BETWEEN ? AND ?"
            for position, data in self._store.read(sql, (self._session, first - 1, target - 1)):
                try:
                    core.restore(msgspec.json.decode(data), position * len(self._plan.spec.properties) + 1)
                except (EngineError, KeyError, TypeError, ValueError):
                    core = self._fresh()
                else:
                    return core, position
        if first > 1:
            raise NoExplanationError(_GONE)
        return core, 0

    def _fresh(self) -> Session:
        self._recorded = []
        spec = self._plan.spec
        core = Session(self._plan, [[self._engine(i, p) for i, p in enumerate(spec.properties)] for _ in orders(spec)])
        for judge in core.judges.values():
            judge.remember(_REMEMBERED, _EFFORT)
        return core

    def _engine(self, index: int, prop: Property) -> Engine:
        if prop.engine in _NATIVE and (index == self._index or prop.engine != "reelay"):
            return NativeEngine(prop.formula, prop.time)
        engine = _Recorded()
        self._recorded.append((index, engine))
        return engine

    def _rows(self, start: int, last: int) -> Iterator[Row]:
        sql = f"SELECT {_COLUMNS} FROM steps WHERE session = ? AND position > ? AND position <= ? ORDER BY position"  # noqa: S608
        yield from self._store.each(sql, (self._session, start, last))


class _Recorded:
    """Says what was said."""

    def __init__(self) -> None:
        self.outcome = Outcome.UNKNOWN

    def step(self, time: int, matches: Matches) -> Outcome:  # noqa: ARG002 -- as every engine
        """The recorded outcome."""
        return self.outcome
