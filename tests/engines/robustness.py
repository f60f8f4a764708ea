"""The robustness of past STL as it is defined, recomputed at every sample; and random formulas in rtamt's syntax."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hypothesis import strategies as st

Sample = Mapping[str, float]
SIGNALS = ("a", "b")


@dataclass(frozen=True)
class Node:
    """A predicate (`kind` its comparison, with its signal and number), or an operator over `parts`."""

    kind: str
    parts: tuple[Node, ...] = ()
    bound: tuple[int, int] | None = None
    signal: str = ""
    number: int = 0

    def __str__(self) -> str:
        within = "" if self.bound is None else f"[{self.bound[0]}:{self.bound[1]}]"
        match self.parts:
            case ():
                return f"({self.signal} {self.kind} {self.number})"
            case (only,):
                return f"({self.kind}{within} {only})"
            case (left, right):
                return f"({left} {self.kind}{within} {right})"
        raise AssertionError(self)


def value(node: Node, samples: Sequence[Sample], times: Sequence[int], now: int) -> float:
    """The robustness at sample number `now`; `times` are in the unit of the bounds."""

    def at(part: int, then: int) -> float:
        return value(node.parts[part], samples, times, then)

    lower, upper = node.bound or (0, math.inf)
    window = [then for then in range(now + 1) if lower <= times[now] - times[then] <= upper]
    match node.kind:
        case "<" | "<=":
            return node.number - samples[now][node.signal]
        case ">" | ">=":
            return samples[now][node.signal] - node.number
        case "==":
            return -abs(samples[now][node.signal] - node.number)
        case "!==":
            return abs(samples[now][node.signal] - node.number)
        case "not":
            return -at(0, now)
        case "and":
            return min(at(0, now), at(1, now))
        case "or":
            return max(at(0, now), at(1, now))
        case "->":
            return max(-at(0, now), at(1, now))
        case "iff" | "xor":
            apart = 0.0 if at(0, now) == at(1, now) else abs(at(0, now) - at(1, now))
            return -apart if node.kind == "iff" else apart
        case "prev":
            return at(0, now - 1) if now else math.inf
        case "rise":
            return min(-at(0, now - 1), at(0, now)) if now else at(0, now)
        case "fall":
            return min(at(0, now - 1), -at(0, now)) if now else -at(0, now)
        case "once":
            return max((at(0, then) for then in window), default=-math.inf)
        case "historically":
            return min((at(0, then) for then in window), default=math.inf)
        case "since":
            held = (min([at(1, then), *(at(0, k) for k in range(then + 1, now + 1))]) for then in window)
            return max(held, default=-math.inf)
    raise AssertionError(node.kind)


_predicates = st.builds(
    Node,
    st.sampled_from(["<", "<=", ">", ">=", "==", "!=="]),
    signal=st.sampled_from(SIGNALS),
    number=st.integers(-1, 2),
)
_bounds = st.none() | st.tuples(st.integers(0, 2), st.integers(0, 3)).map(lambda b: (b[0], b[0] + b[1]))


def _grown(parts: st.SearchStrategy[Node]) -> st.SearchStrategy[Node]:
    one, two = st.tuples(parts), st.tuples(parts, parts)
    return (
        st.builds(Node, st.sampled_from(["not", "prev", "rise", "fall"]), one)
        | st.builds(Node, st.sampled_from(["and", "or", "->", "iff", "xor"]), two)
        | st.builds(Node, st.sampled_from(["once", "historically"]), one, _bounds)
        | st.builds(Node, st.just("since"), two, _bounds)
    )


formulas = st.recursive(_predicates, _grown, max_leaves=4)
samples = st.fixed_dictionaries({name: st.integers(-2, 3) for name in SIGNALS})
