"""Which engine judges a property: one row an engine. A new engine is its file beside this one, and a row."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import NamedTuple

from oracle_server.core.engine import Engine
from oracle_server.core.errors import EngineError
from oracle_server.core.formula.ahead import looks_ahead
from oracle_server.core.formula.names import Names
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.tree import Formula, Position
from oracle_server.core.plan import Plan
from oracle_server.core.spec import Property, orders
from oracle_server.engines import reelay, stl
from oracle_server.engines.both import BothEngine
from oracle_server.engines.external import ExternalEngine
from oracle_server.engines.native import NativeEngine, engine_of
from oracle_server.engines.reelay import ReelayEngine

_NATIVE = "leave `engine` out, or write `engine: native`"
_UNSHARED = 10
"""Properties of which each may cost what an engine may; more of them share that of so many."""


class Refusal(NamedTuple):
    """Why an engine can't judge a property, and the key of the spec that is to be changed."""

    key: str
    reason: str


def _any(_: Property) -> Refusal | None:
    return None


def _no_doubts(_: Property) -> Iterator[tuple[str, Position]]:
    return iter(())


def _always(_: Property) -> bool:
    return True


def _never(_: Property) -> bool:
    return False


class Row(NamedTuple):
    """An engine.

    `make` returns a fresh one for a property, which may cost a `share` of what engines may. `read` reads a formula in
    the engine's language, with names of `define:` where that has any, and raises `FormulaError`, or `EngineError` where
    something is not installed. `refuses` returns why it can't judge a property, `goes_back` whether it can take steps
    back. A verdict of an `explicable` one is explained on request by the native engine, which reads the same formulas;
    the outcomes of a `native` one are that engine's own. The formulas of a `numeric` one are over numbers, and only
    their signals are known outside it. `doubts` returns what is to be warned of in a formula, each with its place.
    """

    make: Callable[[Property, float], Engine]
    read: Callable[[str, Time, Names], Formula] = parse_formula
    refuses: Callable[[Property], Refusal | None] = _any
    goes_back: Callable[[Property], bool] = _always
    explicable: bool = True
    native: bool = False
    numeric: bool = False
    doubts: Callable[[Property], Iterator[tuple[str, Position]]] = _no_doubts


def _native(prop: Property, share: float) -> Engine:
    return engine_of(prop, share)


def _reelay(prop: Property, _: float) -> Engine:
    return ReelayEngine(prop.formula)


def _both(prop: Property, share: float) -> Engine:
    native = NativeEngine(prop.formula, prop.time, share)
    return BothEngine(native, ReelayEngine(prop.formula)) if _reelay_can(prop) else native


def _rtamt(prop: Property, _: float) -> Engine:
    from oracle_server.engines.stl.engine import StlEngine

    return StlEngine(prop.text, prop.time)


def _external(prop: Property, _: float) -> Engine:
    return ExternalEngine(prop.text)


def _read_stl(text: str, time: Time, _: Names) -> Formula:
    stl.demand()
    from oracle_server.engines.stl.parse import read_stl

    return read_stl(text, time).formula


def _stl_doubts(prop: Property) -> Iterator[tuple[str, Position]]:
    return stl.equalities(prop.text)


def _read_for_reelay(text: str, time: Time, names: Names) -> Formula:
    reelay.demand()
    return parse_formula(text, time, names)


def _reelay_refuses(prop: Property) -> Refusal | None:
    if looks_ahead(prop.formula):
        return _both_refuses(prop)
    reason = reelay.refusal(prop.formula, prop.time)
    return None if reason is None else Refusal("time" if prop.time != "steps" else "formula", reason)


def _both_refuses(prop: Property) -> Refusal | None:
    waits = looks_ahead(prop.formula)
    return Refusal("engine", f"it waits for what comes, which reelay can't; {_NATIVE}") if waits else None


def _reelay_can(prop: Property) -> bool:
    return _reelay_refuses(prop) is None


ENGINES: Mapping[str, Row] = MappingProxyType(
    {
        "auto": Row(_native, native=True),
        "native": Row(_native, native=True),
        "reelay": Row(_reelay, _read_for_reelay, refuses=_reelay_refuses, goes_back=_never),
        "both": Row(
            _both, _read_for_reelay, refuses=_both_refuses, goes_back=lambda prop: not _reelay_can(prop), native=True
        ),
        "rtamt": Row(_rtamt, _read_stl, goes_back=_never, explicable=False, numeric=True, doubts=_stl_doubts),
        "external": Row(_external, goes_back=_never, explicable=False),
    }
)
"""By the names that specs give them."""


def make_engine(prop: Property, share: float = 1) -> Engine:
    """A fresh engine for a property, which may cost a `share` of what engines may; reelay's takes tens of milliseconds.

    Raises `EngineError` where it can't judge the property.
    """
    row = ENGINES[prop.engine]
    refusal = row.refuses(prop)
    if refusal is not None:
        raise EngineError(refusal.reason)
    return row.make(prop, share)


def make_engines(plan: Plan) -> list[list[Engine]]:
    """Fresh engines for a session: for each of its orders, one a property."""
    share = min(1.0, _UNSHARED / len(plan.spec.properties))
    return [[make_engine(p, share) for p in plan.spec.properties] for _ in orders(plan.spec)]
