"""Why a signal has failed, in a few words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from oracle_server.core.expression import tree
from oracle_server.core.expression.expression import Expression
from oracle_server.core.expression.stops import Absent, Exhausted, Failed
from oracle_server.core.expression.tree import Node

_LONGEST = 40
_LARGE = 10**30


def reason(expression: Expression, message: Mapping[str, Any], steps: int, row: Sequence[object] = ()) -> str:
    """Why an expression has no value that may be a signal, of a message, and row, at which its signal has failed."""
    try:
        value = expression.traced.run(message, expression.frame(steps, row))
    except Exhausted:
        return f"costs more than {steps} steps"
    except Absent:
        return "is absent"
    except Failed as failed:
        node = failed.node or expression.tree
        return f"{_found(expression.text, node, failed)}: {failed.why}"
    except Exception:  # noqa: BLE001 as where the signal is computed
        return "can't be computed, by a fault of the server's"
    return f"{_short(expression.text)} is {no_signal(value)}"


def absent_at_an_element(expression: Expression, message: Mapping[str, Any], steps: int) -> str | None:
    """Where an expression is absent: what an element of a comprehension lacks, None where no comprehension does."""
    loops = [node for node in tree.walk(expression.tree) if isinstance(node, tree.Loop)]
    bodies = [body for loop in loops for body in (loop.body, loop.when) if body is not None]
    if not bodies:
        return None
    try:
        expression.traced.run(message, expression.frame(steps))
    except Absent as stop:
        node = stop.node or expression.tree
        if any(body.start <= node.start and node.end <= body.end for body in bodies):
            return f"{_snippet(expression.text, node)} is absent at an element"
    return None


def no_signal(value: Any) -> str:
    """What a value is that can't be a signal, and why."""
    if isinstance(value, int):
        return f"{told(value)}, and a whole number has at most 64 bits as a signal"
    return f"{told(value)}, and a signal is a text, a Boolean or a finite number"


def told(value: Any) -> str:
    """A value in a few words."""
    if isinstance(value, str):
        return f"'{_short(value)}'"
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, int) and not isinstance(value, bool):
        return str(value) if abs(value) < _LARGE else "a very large number"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if isinstance(value, Mapping):
        return "a message"
    return str(value).lower() if isinstance(value, bool) else "no value of a message"


def _found(text: str, node: Node, failed: Failed) -> str:
    """The operands with their values, or the part itself where they are written out."""
    parts, operands = tree.children(node), failed.operands
    if len(parts) == len(operands):
        pairs = [(part, value) for part, value in zip(parts, operands, strict=True) if not _written(part)]
        told_pairs = [f"{_snippet(text, part)} is {told(value)}" for part, value in pairs]
        return " and ".join(told_pairs) or _snippet(text, node)
    values = " and ".join(told(value) for value in operands)
    return f"{_snippet(text, node)} with {values}" if values else _snippet(text, node)


def _written(node: Node) -> bool:
    return isinstance(node, tree.Literal | tree.ListOf)


def _snippet(text: str, node: Node) -> str:
    return _short(text[node.start : node.end])


def _short(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= _LONGEST else line[:_LONGEST] + "…"
