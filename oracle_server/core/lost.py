"""Atoms that can't be judged at a step, since a signal that they read failed."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from oracle_server.core.atoms import canonical
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.plan import View

Lost = tuple[int, tuple[str | None, ...]]
"""An atom's place among its formula's, and the canonical values at its refs, None where that is not known."""


def lost(view: View, signals: Mapping[str, Scalar], failed: Collection[str]) -> list[Lost]:
    """The atoms that read a signal that failed, and that nothing else of the step rules out."""
    found = []
    for test in view.tests:
        if test.reads.isdisjoint(failed):
            continue
        for key, check in test.checks:
            value = signals.get(key)
            if key not in failed and (value is None or (check is not None and not check(value))):
                break
        else:
            found.append((test.index, tuple([None if k in failed else canonical(signals[k]) for k in test.refs])))
    return found
