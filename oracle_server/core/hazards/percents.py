"""Shares from 0 to 1 that are compared with percents: the charge of a battery."""

from __future__ import annotations

from collections.abc import Iterator

from oracle_server.core.errors import ExpressionError, SpecProblem
from oracle_server.core.expression import tree
from oracle_server.core.expression.tokens import place
from oracle_server.core.hazards.misfits import constraint_text
from oracle_server.core.spec import Spec, StreamSpec
from oracle_server.core.typed import StreamTypes

_BATTERY = "sensor_msgs/msg/BatteryState"
_SHARE = "percentage"


def percents(spec: Spec, types: StreamTypes) -> Iterator[SpecProblem]:
    """Warnings of comparisons of a battery's charge, which is from 0 to 1, with more than 1."""
    batteries = [s.key in types and types[s.key].shape.name == _BATTERY for s in spec.streams]
    for i, stream in enumerate(spec.streams):
        for name, text in (stream.signals or {}).items() if batteries[i] else ():
            for node, value in _compared(stream, text):
                message = f"signal '{name}': {_told(text[node.start : node.end], value)}"
                yield SpecProblem(("streams", i, "signals", name), message, place(text, node.start), "warning")
    shares, others = set[str](), set[str]()
    for stream, battery in zip(spec.streams, batteries, strict=True):
        for name, text in ({_SHARE: f"msg.{_SHARE}"} if stream.signals is None else stream.signals).items():
            (shares if battery and text.strip() == f"msg.{_SHARE}" else others).add(name)
    for i, prop in enumerate(spec.properties):
        for atom in prop.atoms if shares else ():
            for constraint in (c for c in atom.constraints if c.key in shares - others):
                if _is_percent(constraint.value):
                    message = f"formula of '{prop.id}': {_told(constraint_text(constraint), constraint.value)}"
                    yield SpecProblem(("properties", i, "formula"), message, atom.at, "warning")


def _compared(stream: StreamSpec, text: str) -> Iterator[tuple[tree.Compare, object]]:
    """The comparisons of the charge with a number that is more than 1."""
    try:
        found = stream.read(text)
    except ExpressionError:
        return  # found by `inspect`
    for node in tree.walk(found.tree):
        if isinstance(node, tree.Compare):
            for one, other in ((node.left, node.right), (node.right, node.left)):
                share = isinstance(one, tree.Path) and one.names == (_SHARE,)
                if share and isinstance(other, tree.Literal) and _is_percent(other.value):
                    yield node, other.value


def _is_percent(value: object) -> bool:
    return isinstance(value, int | float) and value > 1  # a Boolean is not


def _told(compared: str, value: object) -> str:
    return (
        f"`{compared}` compares with {value} what is from 0 to 1, as `{_SHARE}` of {_BATTERY} is defined; {value} % is "
        f"{float(str(value)) / 100:g}; where this robot sends percents all the same, write `double(msg.{_SHARE})` "
        "under `signals`"
    )
