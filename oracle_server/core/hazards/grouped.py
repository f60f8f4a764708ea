"""Two implications that are joined without parentheses, and are read as one within the other."""

from __future__ import annotations

import re
from collections.abc import Iterator

from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import And, Formula, Implies, Or, Position, Time, walk
from oracle_server.core.spec import Property, Spec

_TOKENS = re.compile(
    r"""(?P<skipped>"[^"\n]*"|'[^'\n]*'|\{[^}]*\})|(?P<open>\()|(?P<close>\))"""
    r"""|(?P<implies>->|\bimplies\b)|(?P<joined>\b(?:and|or)\b|&&|\|\|)"""
)


def grouped(spec: Spec) -> Iterator[SpecProblem]:
    """Warnings of `A -> B and C -> D`, where `B and C -> D` is all one right side."""
    for i, prop in enumerate(spec.properties):
        at = _ungrouped(prop.text) if prop.says in ("formula", "pattern") and not _is_foreign(prop) else None
        outer = next((node for node in walk(prop.formula) if _joins(node)), None) if at is not None else None
        if isinstance(outer, Implies) and isinstance(outer.right, Implies):
            message = (
                f"{prop.says} of '{prop.id}': `->` reaches to the end, so that `{render(outer.right, prop.time)}` is "
                f"asked as a whole, where `{render(outer.left, prop.time)}` holds; write "
                f"{_two(outer, outer.right, prop.time)}`… -> (… -> …)` where that is meant"
            )
            yield SpecProblem(("properties", i, "formula"), message, at, severity="warning")


def _is_foreign(prop: Property) -> bool:
    return prop.numeric or prop.external is not None


def _ungrouped(text: str) -> Position | None:
    """The place of the first `->` that stands behind another one and an `and` or `or`, with no parenthesis between."""
    seen = [""]
    for found in _TOKENS.finditer(text):
        kind = found.lastgroup or ""
        if kind == "open":
            seen.append("")
        elif kind == "close" and len(seen) > 1:
            seen.pop()
        elif kind == "implies":
            if seen[-1] == "joined":
                return text.count("\n", 0, found.start()) + 1, found.start() - text.rfind("\n", 0, found.start())
            seen[-1] = kind
        elif kind == "joined" and seen[-1] == "implies":
            seen[-1] = kind
    return None


def _joins(node: Formula) -> bool:
    right = node.right if isinstance(node, Implies) else None
    return isinstance(right, Implies) and right.written is None and isinstance(right.left, And | Or)


def _two(outer: Implies, inner: Implies, time: Time) -> str:
    """What was mostly meant by `and`: two implications. By `or` it may be much else."""
    if not isinstance(inner.left, And):
        return "parentheses around what belongs together, as "
    both = And(Implies(outer.left, inner.left.left), Implies(inner.left.right, inner.right))
    return f"`{render(both, time)}` for two of them, or "
