"""Samples: what one step adds to a derived signal."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from enum import Enum

from oracle_server.core.atoms import AtomTest, canonical
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


def sample_of_events(
    formulas: Sequence[Formula], atoms: Sequence[tree.Atom], tests: Sequence[AtomTest], reserved: Names
) -> Sampler | None:
    """The events of a machine that hold at a step, as bits, and those of which it is not known, higher.

    `atoms` are those of all their formulas, of which `tests` are what is left to test on the stream.
    """
    places, left = {atom: i for i, atom in enumerate(atoms)}, {test.index: test for test in tests}
    sure, tested, texts = 0, list[tuple[int, _Holds, frozenset[str]]](), dict[str, dict[object, int]]()
    for i, formula in enumerate(formulas):
        holds = _compiled(formula, places, left)
        if isinstance(holds, bool):
            sure |= holds << i
            continue
        own = [left[place] for atom in tree.atoms(formula) if (place := places[atom]) in left]
        text = _text_of(formula, own)
        if text is not None:
            bits = texts.setdefault(text[0], {})
            bits[text[1]] = bits.get(text[1], 0) | 1 << i
        else:
            tested.append((1 << i, holds, frozenset[str]().union(*(test.reads for test in own)) - frozenset(reserved)))
    return _sampler_of_events(len(formulas), sure, tested, texts) if sure or tested or texts else None


def _sampler_of_events(
    count: int,
    sure: int,
    tested: Sequence[tuple[int, _Holds, frozenset[str]]],
    texts: Mapping[str, Mapping[object, int]],
) -> Sampler:
    """Of so many events: those that hold anyway, those to be tested, and those by the text of a signal."""
    by_text = [(name, bits.get, sum(bits.values()) << count) for name, bits in texts.items()]

    def sample(_step: Step, signals: Signals, failed: Names, _fresh: Names) -> Value:
        found = sure
        for name, bits_of, unsure in by_text:
            found |= unsure if failed and name in failed else bits_of(signals.get(name), 0)
        for bit, holds, reads in tested:
            if failed and not reads.isdisjoint(failed):
                found |= bit << count
            elif holds(signals):
                found |= bit
        return found or NOTHING

    return sample


def _text_of(formula: Formula, tests: Sequence[AtomTest]) -> tuple[str, str] | None:
    """The signal, and its text, where an event asks on the stream for no more than that: many are looked up at once."""
    if not isinstance(formula, tree.Atom) or len(tests) != 1 or len(tests[0].checks) != 1 or tests[0].orders:
        return None
    ((name, _),) = tests[0].checks
    asked = [c for c in formula.constraints if c.key == name]
    alone = len(asked) == 1 and asked[0].op == "=="
    return (name, asked[0].value) if alone and isinstance(asked[0].value, str) else None


def sample_of_value(sampler: Sampler, values: Sequence[str]) -> Sampler:
    """The place of a signal's sample among some values, as a bit: the last one stands for all others."""
    bits = {value: 1 << i for i, value in enumerate(values[:-1])}
    other, any_of_them = 1 << (len(values) - 1), ((1 << len(values)) - 1) << len(values)

    def sample(step: Step, signals: Signals, failed: Names, fresh: Names) -> Value:
        found = sampler(step, signals, failed, fresh)
        if isinstance(found, Lack):
            return any_of_them if found is FAILED else NOTHING
        return bits.get(found if isinstance(found, str) else canonical(found), other)

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
    if len(test.checks) == 1 and not test.orders:
        ((name, check),) = test.checks
        if check is None:
            return lambda signals: signals.get(name) is not None
        return lambda signals: (value := signals.get(name)) is not None and check(value)
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
