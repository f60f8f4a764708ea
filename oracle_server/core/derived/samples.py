"""Samples: what one step adds to a derived signal."""

from __future__ import annotations

from collections.abc import Callable, Collection
from enum import Enum

from oracle_server.core.atoms import AtomTest
from oracle_server.core.events import Signals, Step
from oracle_server.core.formula import tree
from oracle_server.core.formula.tree import Formula, Scalar
from oracle_server.core.signals import is_signal


class Lack(Enum):
    """What stands for a value: `NOTHING` that there is none, `FAILED` that there is one which is not known."""

    NOTHING = "nothing"
    FAILED = "failed"


NOTHING, FAILED = Lack.NOTHING, Lack.FAILED
Value = Scalar | Lack
Names = Collection[str]
Sampler = Callable[[Step, Signals, Names, Names], Value]
"""A step's sample: by the step, its signals so far, those that failed, and the derived ones of which it has one."""
_Holds = Callable[[Signals], bool]


def sample_of(name: str, numbers: bool) -> Sampler:
    """Samples of a signal of the stream itself."""

    def sample(step: Step, _signals: Signals, _failed: Names, _fresh: Names) -> Value:
        value = step.signals.get(name)
        kind = type(value)
        if kind is float or kind is int:
            return value  # type: ignore[return-value] # as most are
        if value is None:
            return FAILED if name in step.failed else NOTHING
        return FAILED if numbers else value

    return sample


def sample_of_reserved(name: str, numbers: bool) -> Sampler:
    """Samples of a signal that events have without declaring it."""

    def sample(_step: Step, signals: Signals, _failed: Names, _fresh: Names) -> Value:
        value = signals.get(name)
        if value is None:
            return NOTHING
        return value if type(value) is int or not numbers else FAILED

    return sample


def sample_of_derived(name: str, numbers: bool) -> Sampler:
    """Samples of another derived signal: what it is at the steps that added to it."""

    def sample(_step: Step, signals: Signals, failed: Names, fresh: Names) -> Value:
        if name not in fresh:
            return NOTHING
        value = signals.get(name)
        if value is None:
            return FAILED if name in failed else NOTHING
        kind = type(value)
        return value if kind is float or kind is int or not numbers else FAILED

    return sample


def sample_of_any(own: Names, derived: Names) -> Sampler:
    """Whether a step has one of some signals itself: of its stream's own, or derived from these."""

    def sample(step: Step, _signals: Signals, _failed: Names, fresh: Names) -> Value:
        found = any(n in step.signals or n in step.failed for n in own) or any(n in fresh for n in derived)
        return True if found else NOTHING

    return sample


def always(_step: Step, _signals: Signals, _failed: Names, _fresh: Names) -> Value:
    """A sample at each step."""
    return True


def sample_of_formula(formula: Formula, tests: tuple[AtomTest, ...], reads: Names) -> Sampler | None:
    """The steps at which a formula without a past holds; None where none of a stream does.

    `tests` are what is left to test of its atoms on the stream, and `reads` the signals that matter there.
    """
    holds = _compiled(formula, {atom: i for i, atom in enumerate(tree.atoms(formula))}, {t.index: t for t in tests})
    if not reads:
        return always if holds is True else None if holds is False else _plain(holds)
    if holds is False:
        return None

    def sample(_step: Step, signals: Signals, failed: Names, _fresh: Names) -> Value:
        if failed and any(name in failed for name in reads):
            return FAILED
        return True if holds is True or holds(signals) else NOTHING

    return sample


def _plain(holds: _Holds) -> Sampler:
    return lambda _step, signals, _failed, _fresh: True if holds(signals) else NOTHING


def _compiled(formula: Formula, places: dict[tree.Atom, int], tests: dict[int, AtomTest]) -> _Holds | bool:
    """Whether a formula holds at a step, or what it always does."""
    match formula:
        case tree.Atom():
            test = tests.get(places[formula])
            if test is None:
                return False
            return _tested(test) if test.checks else True
        case tree.Not(operand):
            inner = _compiled(operand, places, tests)
            return (not inner) if isinstance(inner, bool) else lambda signals: not inner(signals)
        case tree.And(left, right):
            return _both(_compiled(left, places, tests), _compiled(right, places, tests))
        case tree.Or(left, right):
            return _either(_compiled(left, places, tests), _compiled(right, places, tests))
        case tree.Implies(left, right):
            return _either(_compiled(tree.Not(left), places, tests), _compiled(right, places, tests))
    raise TypeError(f"no formula of one step: {formula}")


def _tested(test: AtomTest) -> _Holds:
    return lambda signals: test.match(signals) is not None


def _both(left: _Holds | bool, right: _Holds | bool) -> _Holds | bool:
    if isinstance(left, bool):
        return right if left else False
    if isinstance(right, bool):
        return left if right else False
    return lambda signals: left(signals) and right(signals)


def _either(left: _Holds | bool, right: _Holds | bool) -> _Holds | bool:
    if isinstance(left, bool):
        return True if left else right
    if isinstance(right, bool):
        return True if right else left
    return lambda signals: left(signals) or right(signals)


def known(value: Scalar) -> Value:
    """A value that was computed, or that it is none that a signal can have."""
    return value if is_signal(value) else FAILED
