"""Atoms against signals: which hold at a step, and which values they bind.

The engines see no signals: they get, for each atom of their formula, None where it does not hold, else the canonical
texts of the values that its variables must have, and behind them of those that it compares with variables. Types,
absence and numbers' spellings end here.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from hashlib import sha256
from itertools import combinations
from json.encoder import encode_basestring_ascii

from oracle_server.core.events import Signals
from oracle_server.core.formula.tree import Any, Atom, Constraint, Limit, Ref, Scalar, Signal

Match = tuple[str, ...] | None
"""None: the atom does not hold; else the canonical values of its refs, in their order."""
Matches = Sequence[Match]

_LONG = 1_024
"""Characters of a text that is kept as it is, where the values of a variable are kept."""
_SHOWN = 64

_ORDERED: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


def canonical(value: Scalar) -> str:
    """The value as JSON text, one text for all equal values: 7 and 7.0 give `7`, "7" gives `"7"`.

    A long text is `shortened`.
    """
    if isinstance(value, str):
        return encode_basestring_ascii(value if len(value) <= _LONG else _short(value))
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return str(value)


def shortened(value: Scalar) -> Scalar:
    """What stands for a value among many that are kept: of a long text its beginning and its hash, else the value.

    Many texts of a megabyte each would take all memory.
    """
    return value if not isinstance(value, str) or len(value) <= _LONG else _short(value)


@lru_cache(maxsize=8)
def _short(text: str) -> str:
    """The same of a long text. Of one event many properties may want it, and few texts are long."""
    digest = sha256(text.encode(errors="surrogatepass")).hexdigest()
    return f"{text[:_SHOWN]}… ({len(text)} characters, SHA-256 {digest})"


def same(left: Scalar, right: Scalar) -> bool:
    """Whether two values are equal: numbers by value, never to strings or booleans."""
    return left == right and isinstance(left, bool) == isinstance(right, bool)


def meets(constraint: Constraint, value: Scalar) -> bool:
    """Whether a present value meets a constraint, or can: a variable is met by all, what compares by a number."""
    wanted = constraint.value
    if isinstance(wanted, Any | Ref):
        return True
    if isinstance(wanted, Signal | Limit):
        return not isinstance(value, str | bool)
    if constraint.op == "==":
        return same(value, wanted)
    if constraint.op == "!=":
        return not same(value, wanted)
    if isinstance(value, str | bool) or isinstance(wanted, str | bool):
        return False
    return _ORDERED[constraint.op](value, wanted)


def precedes(left: Scalar | None, op: str, right: Scalar | None) -> bool:
    """Whether two values compare: both must be there, and be numbers."""
    if left is None or right is None or isinstance(left, str | bool) or isinstance(right, str | bool):
        return False
    return _ORDERED[op](left, right)


Check = Callable[[Scalar], bool]


@dataclass(frozen=True, slots=True)
class AtomTest:
    """What is left to test of an atom on one stream: `index` is the atom's place among those of its formula.

    `checks` are the signals that must be there, each with what its value must meet, None where any will do; `orders`
    are those that are compared with others, by which operator, and with which; `twins` those of which two must have one
    value, since they bind the same variable.
    """

    index: int
    checks: tuple[tuple[str, Check | None], ...]
    refs: tuple[str, ...]
    orders: tuple[tuple[str, str, str], ...] = ()
    twins: tuple[tuple[str, str], ...] = ()

    @property
    def reads(self) -> frozenset[str]:
        """The signals that matter."""
        return frozenset(key for key, _ in self.checks)

    def match(self, signals: Signals) -> Match:
        """The values of the atom's refs where it holds, else None."""
        for key, check in self.checks:
            value = signals.get(key)
            if value is None or (check is not None and not check(value)):
                return None
        for key, op, other in self.orders:
            if not precedes(signals.get(key), op, signals.get(other)):
                return None
        return tuple([canonical(signals[key]) for key in self.refs])


def specialise(atoms: Sequence[Atom], known: Signals, possible: Callable[[str], bool]) -> tuple[AtomTest, ...]:
    """The atoms that can hold on a stream, with what depends on the event alone.

    `known` are the signals that every event of the stream has with the same value; `possible` returns whether
    an event of the stream can have a signal of that name at all.
    """
    return specialise_some(enumerate(atoms), known, possible)


def specialise_some(
    atoms: Iterable[tuple[int, Atom]], known: Signals, possible: Callable[[str], bool]
) -> tuple[AtomTest, ...]:
    """The same of some of the atoms, each with its place among all."""
    tests = []
    for index, atom in atoms:
        if all(meets(c, known[c.key]) if c.key in known else possible(c.key) for c in atom.constraints):
            checks = tuple((c.key, _check(c)) for c in atom.constraints if c.key not in known)
            orders = tuple((c.key, c.op, c.value.name) for c in atom.constraints if isinstance(c.value, Signal))
            refs = (*(key for key, _ in atom.refs), *(c.key for c in atom.limits))
            tests.append(AtomTest(index, checks, refs, orders, _twins(atom)))
    return tuple(tests)


def _twins(atom: Atom) -> tuple[tuple[str, str], ...]:
    """The pairs of its signals that bind the same variable."""
    pairs = combinations(atom.refs, 2)
    return tuple((one, other) for (one, name), (other, same_name) in pairs if name == same_name and one != other)


def _check(constraint: Constraint) -> Check | None:
    wanted = constraint.value
    if isinstance(wanted, Any | Ref | Signal):
        return None
    if isinstance(wanted, Limit):
        return partial(meets, constraint)
    if constraint.op == "==":  # as most are
        return _equals(wanted)
    return partial(meets, constraint)


def _equals(wanted: Scalar) -> Check:
    """What `same` is with one value known."""
    if isinstance(wanted, str):
        return lambda value: value == wanted
    if isinstance(wanted, bool):
        return lambda value: value is wanted
    return lambda value: value == wanted and value is not True and value is not False
