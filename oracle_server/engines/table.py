"""Which engine judges a property."""

from __future__ import annotations

from oracle_server.core.engine import Engine
from oracle_server.core.errors import EngineError
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.tree import Formula
from oracle_server.core.plan import Plan
from oracle_server.core.session import orders
from oracle_server.core.spec import Property
from oracle_server.engines import stl
from oracle_server.engines.both import BothEngine
from oracle_server.engines.external import ExternalEngine
from oracle_server.engines.native import NativeEngine
from oracle_server.engines.reelay import ReelayEngine
from oracle_server.engines.reelay import refusal as reelay_refusal

_UNSHARED = 10
"""Up to so many properties may each cost what an engine may; more of them share the cost of so many."""


def read_formula(text: str, time: Time, engine: str) -> Formula:
    """A property's formula, in the language of its engine; of one in rtamt's, the signals that it reads.

    Raises `FormulaError`, and `EngineError` where rtamt is not installed.
    """
    if engine != "rtamt":
        return parse_formula(text, time)
    stl.demand()
    from oracle_server.engines.stl.parse import read_stl

    return read_stl(text, time).formula


def refusal(prop: Property) -> str | None:
    """Why no engine of this version can judge a property as its spec asks, None where one can."""
    return reelay_refusal(prop.formula, prop.time) if prop.engine == "reelay" else None


def goes_back(prop: Property) -> bool:
    """Whether the engine that judges a property can take steps back."""
    return prop.engine in ("auto", "native") or (prop.engine == "both" and not _compares(prop))


def make_engine(prop: Property, share: float = 1) -> Engine:
    """A fresh engine for a property, which may cost a `share` of what engines may; reelay's takes tens of milliseconds.

    Raises `EngineError` where there is none.
    """
    reason = refusal(prop)
    if reason:
        raise EngineError(reason)
    if prop.external is not None:
        return ExternalEngine(prop.text)
    if prop.engine == "reelay":
        return ReelayEngine(prop.formula)
    if prop.engine == "rtamt":
        from oracle_server.engines.stl.engine import StlEngine

        return StlEngine(prop.text, prop.time)
    native = NativeEngine(prop.formula, prop.time, share)
    return BothEngine(native, ReelayEngine(prop.formula)) if _compares(prop) else native


def _compares(prop: Property) -> bool:
    """Whether reelay judges a property too, where it can."""
    return prop.engine == "both" and reelay_refusal(prop.formula, prop.time) is None


def make_engines(plan: Plan) -> list[list[Engine]]:
    """Fresh engines for a session: for each of its orders, one a property."""
    share = min(1.0, _UNSHARED / len(plan.spec.properties))
    return [[make_engine(p, share) for p in plan.spec.properties] for _ in orders(plan.spec)]
