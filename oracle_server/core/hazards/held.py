"""Signals that are held, and are not what events of other streams are meant to see."""

from __future__ import annotations

from collections.abc import Iterator

from oracle_server.core.errors import ExpressionError, SpecProblem
from oracle_server.core.expression import parse_expression
from oracle_server.core.spec import Spec, StreamSpec


def held_elsewhere(spec: Spec) -> Iterator[SpecProblem]:
    """Signals that another stream holds: a warning, since histories may have sessions with such specs."""
    holders = {name: stream.key for stream in spec.streams for name in stream.hold if stream.declares(name)}
    for i, stream in enumerate(spec.streams):
        for name in sorted(n for n in stream.signals or () if n in holders and n not in stream.hold):
            message = (
                f"'{name}' is a signal of {stream.key}, and held by {holders[name]}: formulas see what is held "
                f"at every event of {stream.key} that lacks its own; give one of them another name"
            )
            yield SpecProblem(("streams", i, "signals", name), message, severity="warning")


def held_of_rows(spec: Spec) -> Iterator[SpecProblem]:
    """Signals of rows that are held: each row takes the place of the one before, which no other stream's event sees."""
    for i, stream in enumerate(spec.streams):
        for name in sorted(stream.hold):
            if is_row_by_row(stream, name):
                message = (
                    f"'{name}' is held of the last row of a message of {stream.key} alone: events of other streams "
                    "do not see what the rows before it said; hold what is computed of the whole list, as in "
                    f"`any: {stream.each}.exists(r, …)` under `signals`, or choose one row, as in "
                    f"`each: {stream.each}.filter(r, …)`"
                )
                yield SpecProblem(("streams", i, "hold"), message, severity="warning")


def is_row_by_row(stream: StreamSpec, name: str) -> bool:
    """Whether a signal of a stream is another one at each row of a message, whichever rows these are."""
    text = (stream.signals or {}).get(name)
    if stream.each is None or text is None:
        return False
    try:
        return parse_expression(stream.each).is_field and stream.read(text).is_of_row  # else one row may be chosen
    except ExpressionError:
        return False  # which is told of where it stands
