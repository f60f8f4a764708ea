"""Patterns of how often: the derived signal that each is measured by, and what it must be."""

from __future__ import annotations

import re
from fractions import Fraction

from oracle_server.core.derived.definition import Definition
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Atom, Constraint, Formula, Not
from oracle_server.core.sentences.reader import Reader
from oracle_server.core.sentences.tokens import place

_HERTZ = re.compile(r"(\d+(?:\.\d+)?)([A-Za-z]*)")


def measure(reader: Reader, event: Formula) -> Formula | None:
    """The formula of what stands behind an event: `every 1s`, `at least 10 Hz over 2s`; None for anything else."""
    if reader.word("every"):
        return _limit(reader, "age", event, "<=", _time(reader) / 10**9)
    word = reader.phrase("at", "least") or reader.phrase("at", "most")
    if word is None:
        return None
    low = reader.pieces[reader.at - 1].text.lower() == "least"
    wanted = _hertz(reader)
    if not reader.word("over"):
        reader.refuse(
            "over how long? write `over 2s` behind the rate: a time in which some events come", None, ("over",)
        )
    over = _time(reader)
    if low:
        return Not(_limit(reader, "rate", event, "<", float(wanted), over))
    # too many are too many before `over` has passed as well, when there is no rate yet
    return at_most(reader, wanted * over // 10**9, event, over)


def at_most(reader: Reader, number: int, event: Formula, window: int) -> Formula:
    """`at most 3 E within 1s`."""
    return _limit(reader, "count", event, "<=", number, window)


def _limit(reader: Reader, op: str, event: Formula, sign: str, limit: float, over: int | None = None) -> Formula:
    """Make the derived signal, and compare it."""
    name = f"{reader.name}.{op}"
    reader.measures.append(Definition(name, op, render(event), event, over))  # type: ignore[arg-type] # one of these
    number = int(limit) if limit == int(limit) else limit
    at = place(reader.text, reader.pieces[reader.at - 1].start)
    return Atom((Constraint(name, sign, number),), at)  # type: ignore[arg-type] # one of these


def _time(reader: Reader) -> int:
    """A duration in nanoseconds, longer than none."""
    piece = reader.next
    distance, counted = reader.duration()
    if counted == "steps":
        reader.refuse("how often is a matter of time: write a duration, as `2s`", piece)
    if not distance:
        reader.refuse("a time is longer than `0s` here", piece)
    return distance


def _hertz(reader: Reader) -> Fraction:
    piece = reader.take()
    match = _HERTZ.fullmatch(piece.text)
    unit = match and (match[2] or reader.take().text)
    if match is None or unit is None or unit.lower() not in ("hz", "hertz") or len(match[1]) > 18:
        reader.refuse(f"here stands a rate, as `10 Hz`, and not {reader.shown(piece)}", piece)
    return Fraction(match[1])
