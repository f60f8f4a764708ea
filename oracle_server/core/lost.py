"""Atoms that can't be judged at a step, since a signal that they read failed."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from oracle_server.core.atoms import AtomTest, canonical, precedes
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.plan import View

Lost = tuple[int, tuple[str | None, ...]]
"""An atom's place among its formula's, and the canonical values at its refs, None where that is not known."""


def lost(view: View, signals: Mapping[str, Scalar], failed: Collection[str]) -> list[Lost]:
    """The atoms that read a signal that failed, and that nothing else of the step rules out."""
    return [
        (test.index, tuple([None if k in failed else canonical(signals[k]) for k in test.refs]))
        for test in view.tests
        if not test.reads.isdisjoint(failed) and _may_hold(test, signals, failed)
    ]


def _may_hold(test: AtomTest, signals: Mapping[str, Scalar], failed: Collection[str]) -> bool:
    """Whether an atom holds for some values of the signals that failed."""
    for key, check in test.checks:
        value = signals.get(key)
        if key not in failed and (value is None or (check is not None and not check(value))):
            return False
    for key, op, other in test.orders:
        known = [signals.get(name) for name in (key, other) if name not in failed]
        if not (precedes(known[0], op, known[1]) if len(known) == 2 else all(map(_is_number, known))):
            return False
    return not any(
        canonical(signals[one]) != canonical(signals[other])
        for one, other in test.twins
        if one not in failed and other not in failed
    )


def _is_number(value: Scalar | None) -> bool:
    return value is not None and not isinstance(value, str | bool)
