"""Machines of a spec file: their states, events and sequences read, each at its place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from yaml import events as yaml_events

from oracle_server.core.derived.definition import OPS, Definition
from oracle_server.core.errors import FormulaError, OracleError
from oracle_server.core.formula.names import Names
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.formula.tree import Formula, Position
from oracle_server.core.machines.making import MAX_VALUES, STAY, by_states, by_values
from oracle_server.core.machines.sequence import by_sequence, unknown_event
from oracle_server.core.machines.table import ERROR, MAX_STATES, Limit, Table
from oracle_server.core.nearest import listed, nearest
from oracle_server.core.units import duration
from oracle_server.specfiles.document import Document, KeyPath
from oracle_server.specfiles.model import DeriveModel

_LIMITS = ("within", "leave")


class MachineError(OracleError):
    """What is wrong with a machine, and where: in the text at a path, or at the key that it ends in."""

    def __init__(self, message: str, *path: str | int, within: Position | None = None, at_key: bool = False) -> None:
        super().__init__(message)
        self.message, self.path, self.within, self.at_key = message, path, within, at_key


def is_machine(model: DeriveModel) -> bool:
    """Whether a derived signal is said by the keys of a machine."""
    return any(getattr(model, key) is not None for key in ("follows", "states", "sequence", "start", "otherwise"))


def is_read(definition: Definition | None) -> bool:
    """Whether a machine could be read."""
    return definition is not None and definition.table is not None


def read_machine(document: Document, name: str, model: DeriveModel, names: Names) -> Definition:
    """A machine, whose events are among the `names` of formulas. Raises `MachineError`."""
    _check_keys(model)
    by, forget = model.by or (), model.forget
    if model.sequence is not None:
        try:
            table = by_sequence(model.sequence, _events(names))
        except FormulaError as error:
            raise MachineError(error.message, "sequence", within=(error.line, error.column)) from None
        return Definition(
            name, "sequence", model.sequence, by=by, forget=forget, table=table, events=_formulas(table, names)
        )
    reading = _Reading(document, name, model.states or {})
    if model.follows is not None:
        table = by_values(reading.successors())
        return Definition(name, "follows", model.follows, by=by, forget=forget, table=table)
    table = reading.table(model, names)
    if len(by) > 1 and table.limits:
        limit = table.limits[0]
        key = "leave" if limit.within is None else "within"
        raise MachineError(
            f"with several signals in `by` there is no `{key}`: it would not hear of an event that has some of them "
            "alone; say it as a property, as `forall[a, b]. {a: *a, b: *b, opens} -> eventually[:30s] {…}`",
            "states",
            limit.state,
            key,
        )
    return Definition(
        name, "states", ", ".join(reading.states), by=by, forget=forget, table=table, events=_formulas(table, names)
    )


def _check_keys(model: DeriveModel) -> None:
    operations = ("expression", *(op for op, traits in OPS.items() if not traits.machine), "over")
    other = next((key for key in operations if getattr(model, key) is not None), None)
    if other is not None:
        raise MachineError(f"a machine takes no `{other}`; give that a name of its own", other)
    if model.forget is not None and model.by is None:
        raise MachineError("`forget` is for what is kept `by` a signal; leave it out", "forget")
    if model.by is not None and len(set(model.by)) < len(model.by):
        raise MachineError("a signal stands twice in `by`; leave it out there", "by")
    if model.sequence is None:
        _check_states(model)
    for key in ("follows", "states", "start", "otherwise") if model.sequence is not None else ():
        if getattr(model, key) is not None:
            raise MachineError(f"a sequence takes no `{key}`: it is the order of its events alone", key)


def _check_states(model: DeriveModel) -> None:
    if model.states is None or not model.states:
        key = "follows" if model.follows is not None else "start" if model.start is not None else "otherwise"
        key = "states" if model.states is not None else key
        raise MachineError("it has no states: write them, as `states: {IDLE: [AUTO], AUTO: [IDLE]}`", key)
    if model.follows is not None:
        for key in ("start", "otherwise"):
            if getattr(model, key) is not None:
                raise MachineError(
                    f"with `follows` there is no `{key}`: the first value is where it begins, and a change that is "
                    "not listed is an error",
                    key,
                )
    elif model.start is None:
        raise MachineError(f"where does it begin? write `start: {next(iter(model.states))}`", "states")
    most = MAX_STATES if model.follows is None else MAX_VALUES
    if len(model.states) > most:
        raise MachineError(f"it has {len(model.states):,} states, and at most {most:,} are taken", "states")


def _events(names: Names) -> list[str]:
    """The names that may be events: those without variables."""
    return [name for name, named in names.known.items() if not named.call.arguments]


def _formulas(table: Table, names: Names) -> tuple[Formula, ...]:
    found = []
    for event in table.events:
        try:
            found.append(parse_formula(event, names=names))
        except FormulaError as error:
            raise MachineError("" if error.told else error.message, "states") from None
    return tuple(found)


class _Reading:
    """The states of a machine as they are written."""

    def __init__(self, document: Document, name: str, states: Mapping[str, Any]) -> None:
        self.document, self.name, self.states = document, name, states

    def successors(self) -> dict[str, list[str]]:
        """For each value of a followed signal those that may follow."""
        found: dict[str, list[str]] = {}
        for state, row in self.states.items():
            if state == ERROR:
                raise MachineError(
                    f"`{ERROR}` is what the machine is in after a change that is not listed; give the value another "
                    "name where its signal is made",
                    "states",
                    state,
                )
            if row is not None and not isinstance(row, list):
                what = f"[{row}]" if not isinstance(row, dict) else f"[{', '.join(map(str, row)) or 'OTHER'}]"
                raise MachineError(f"here stands a list of the states that may follow, as {what}", "states", state)
            places = [("states", state, i) for i in range(len(row or ()))]
            found[state] = [self._target(place) for place in places]
        return found

    def table(self, model: DeriveModel, names: Names) -> Table:
        """The machine of these states."""
        start, otherwise = str(model.start), ERROR if model.otherwise is None else model.otherwise
        self._known(start, ("start",))
        if otherwise not in (ERROR, STAY):
            self._known(otherwise, ("otherwise",))
        rows: dict[str, dict[str, str]] = {}
        limits: list[Limit] = []
        for state, row in self.states.items():
            if state == STAY:
                raise MachineError(f"a state can't be called `{STAY}`, which `otherwise` says", "states", state)
            if row is not None and not isinstance(row, dict):
                raise MachineError(
                    f"here stand events, each with the state it leads to, as {{start: {next(iter(self.states))}}}; "
                    "a state that is never left has {}",
                    "states",
                    state,
                )
            rows[state] = {event: self._moves(state, event, names) for event in row or () if event not in _LIMITS}
            limits += self._limits(state, row or {})
        return by_states(rows, start, otherwise, limits)

    def _moves(self, state: str, event: str, names: Names) -> str:
        """The state that an event leads to."""
        path = "states", state, event
        known = _events(names)
        if event not in known:
            named = names.known.get(event.partition("(")[0].strip())
            if named is not None:
                raise MachineError(
                    f"`{named.head}` has variables, and an event has none: machines are told apart `by` a signal",
                    *path,
                    at_key=True,
                )
            raise MachineError(f"unknown event '{event}'; {unknown_event(event, known)}", *path, at_key=True)
        return self._target(path)

    def _target(self, path: KeyPath) -> str:
        """The state that stands at a path."""
        found = self.document.values.get(("derive", self.name, *path))
        if not isinstance(found, yaml_events.ScalarEvent) or (not found.value and found.implicit[0]):
            raise MachineError("here stands the state that it leads to", *path)
        text = str(found.value)
        if text != ERROR or (len(path) == 3 and isinstance(path[2], int)):
            self._known(text, path)
        return text

    def _known(self, state: str, path: KeyPath) -> None:
        if state not in self.states:
            hint = nearest(state, self.states)
            raise MachineError(
                f"unknown state '{state}'; {f'{hint} ' if hint else ''}there are {listed(self.states)}, and one that "
                f"is never left is written `{state}: {'[]' if isinstance(path[-1], int) else '{}'}`",
                *path,
            )

    def _limits(self, state: str, row: Mapping[str, Any]) -> Iterator[Limit]:
        if (value := row.get("within")) is not None:
            try:
                within = duration(value)
            except ValueError as error:
                raise MachineError(f"`within`: {error}", "states", state, "within") from None
            if not within:
                raise MachineError("a state is to be left within more than 0s", "states", state, "within")
            yield Limit(state, within)
        leave = row.get("leave", False)
        if not isinstance(leave, bool):
            raise MachineError(
                f"`leave` is true, for a state that is to be left again; found {leave}", "states", state, "leave"
            )
        if leave and value is None:
            yield Limit(state)
