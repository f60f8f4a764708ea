"""What is doubtful in derived signals: what never holds or comes, and events that come again and again."""

from __future__ import annotations

import json
import operator
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from math import ceil

from oracle_server.core.atoms import canonical
from oracle_server.core.derived.definition import OPS, Definition
from oracle_server.core.derived.machinery import KeyPath, placed
from oracle_server.core.derived.words import for_each
from oracle_server.core.errors import SpecProblem
from oracle_server.core.expression import check_shape, tokens, tree
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Any, Atom, Constraint, Formula, Position, Scalar, atoms
from oracle_server.core.hazards.held import is_row_by_row
from oracle_server.core.hazards.lacks import quoted, whose
from oracle_server.core.hazards.misfits import counted, described, misfits, range_at
from oracle_server.core.hazards.namesakes import named, namesake
from oracle_server.core.hazards.places import Place, places
from oracle_server.core.hazards.withholding import lasting, present, without_signals
from oracle_server.core.ranges import Range
from oracle_server.core.shapes import Record, Value
from oracle_server.core.signals import is_signal
from oracle_server.core.spec import SECOND, Property, Spec
from oracle_server.core.typed import StreamTypes
from oracle_server.core.units import span

_MARKS = {
    "==": operator.eq, "!=": operator.ne, "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
}  # fmt: skip
_BY_SAMPLE = ("last", "previous", "delta", "follows")
_AT_MOST = re.compile(r"\bat\s+most\s+(\d+(?:\.\d+)?)\s*(?:hz|hertz)\b", re.IGNORECASE)


def doubtful_derived(spec: Spec, types: StreamTypes) -> Iterator[SpecProblem]:
    """Warnings about the derived signals of a spec without errors, whose messages have these types."""
    where = places(spec, "steps", types) if spec.derive else []
    names = named(spec)
    derived = frozenset(definition.name for definition in spec.derive)
    for definition in spec.derive:
        path = "derive", definition.name, definition.op
        for at, formula, start in placed(definition):
            doubts = [*_doubts(formula, where), *(_repeated(definition, formula, spec) if definition.table else ())]
            doubts += [(message, atom.at) for atom in atoms(formula) for message in namesake(atom, names, where)]
            for message, place in doubts:
                yield _warning(definition, at, message, start or place)
        for message in _unsampled(definition, where, derived):
            yield _warning(definition, path, message, None)
        for message in _always_failing(definition, where):
            yield replace(_warning(definition, path, message, None), kind="unjudged")
        for message, at_part in _with_itself(definition, where) if definition.op == "expression" else ():
            yield _warning(definition, path, message, at_part)
        for message, variable_at in for_each(definition):
            yield _warning(definition, path, message, variable_at)
        for message in (*_of_rows(definition, where), *_across_rows(definition, spec), *_of_one(definition)):
            yield _warning(definition, path, message, None)
        if definition.op == "follows":
            yield from _unfollowed(definition, where)
    yield from _across_streams(spec)
    yield from _less_than_one(spec)


def _of_one(definition: Definition) -> Iterator[str]:
    """A window of one sample, where a second was mostly meant."""
    if definition.counted and definition.over == 1 and definition.op in ("sum", "mean", "min", "max"):
        yield f"the last sample alone is `{definition.of}` itself; write `over: 1s`, or more samples, as `over: 20`"


def _doubts(formula: Formula, where: Sequence[Place]) -> Iterator[tuple[str, Position]]:
    """What is doubtful in a formula of one step, each with a place in its text."""
    tested = atoms(formula)
    found = [(doubt.message, doubt.at) for atom in tested for doubt in misfits(atom, where)]
    if found or any(_may_hold(formula, place) for place in where):
        yield from found
        return
    message, at = f"`{render(formula)}` never holds, whatever the messages say", min(atom.at for atom in tested)
    for atom in tested:
        lacking = [place for place in where if place.allows(atom) and place.lacks(atom)]
        if lacking:
            keys = sorted({key for place in lacking for key in place.lacks(atom)})
            message, at = f"{message}: {whose(where, lacking, keys)}", atom.at
            break
    yield message, at


def _may_hold(formula: Formula, place: Place) -> bool:
    return present(formula, place.value) is not False


def _unsampled(definition: Definition, where: Sequence[Place], derived: frozenset[str]) -> Iterator[str]:
    """What is absent everywhere, and what is kept by keys that no sample has."""
    if all(definition.name in place.lack for place in where):
        keys = [name for name in definition.needed if not any(place.has(name) for place in where)] or definition.needed
        if not any(place.lack.get(name) for place in where for name in definition.needed):
            yield f"it is never there: {_apart(keys, where)}"
        return
    sampled = [place for place in where if _may_sample(definition, place, derived)]
    if definition.by and sampled and not any(all(place.has(by) for by in definition.by) for place in sampled):
        what = "no event of it" if definition.table is not None else "none of its samples"
        lacking = [by for by in definition.by if not all(place.has(by) for place in sampled)]
        made = "makes a machine: none" if len(definition.by) > 1 else "counts: none"
        has = f"has {'all of ' if len(definition.by) > 1 else ''}{quoted(definition.by)}"
        yield f"{what} {made} {has}; {_apart(lacking, where)}"


def _always_failing(definition: Definition, where: Sequence[Place]) -> Iterator[str]:
    """Why a signal fails wherever it is computed: what it is computed of is no number, or does not go together."""
    if definition.formulas:
        return
    known = {name: range_at(name, [p for p in where if p.has(name)]) for name in definition.operands}
    if definition.op == "expression":
        shapes = {name: shape for name, found in known.items() if (shape := _shape(found)) is not None}
        if len(shapes) == len(known):
            problems = check_shape(definition.expression, Record("", shapes))
            yield from (each.message for each in problems if each.severity == "error")
    elif OPS[definition.op].numbers:
        (found,) = known.values()
        if found != Range() and not found.has_numbers:
            takes = f"it always fails: `{definition.op}` takes numbers"
            yield f"{takes}, and `{definition.of}` is always {described(found)}"


def _of_rows(definition: Definition, where: Sequence[Place]) -> Iterator[str]:
    """What counts the rows of messages, whatever these are, where it seems to count messages."""
    if definition.op not in ("count", "rate") or definition.formula is None:
        return
    rows = [p.stream for p in where if p.stream and p.stream.each and present(definition.formula, p.value) is True]
    if rows:
        event = f'{{{rows[0].traits.group}: "{rows[0].name}", row: 0}}'
        yield (
            f"it counts the rows of {rows[0].key}, and not its messages, each of which has as many as its list; to "
            f"count messages write `row: index` under its `signals`, and ask for `{event}`"
        )


def _across_rows(definition: Definition, spec: Spec) -> Iterator[str]:
    """What goes from one sample to the next, where these are rows of a message, whichever they are."""
    if definition.by or definition.op not in _BY_SAMPLE:
        return
    stream = next((s for s in spec.streams if is_row_by_row(s, definition.of)), None)
    if stream is None:
        return
    other = next((name for name in stream.signals or () if name != definition.of), "row")
    index = "" if other != "row" else ", with `row: index` under its `signals`"
    yield (
        f"its samples are the rows of {stream.key}, one after the other, whichever these are: the next one is mostly "
        f"another row of the same message; keep it by what tells rows apart, as in `by: {other}, forget: 1h`{index}"
    )


def _across_streams(spec: Spec) -> Iterator[SpecProblem]:
    """What goes from one sample to the next, where these are of several streams, whichever speaks."""
    for definition in spec.derive:
        having = [str(stream.key) for stream in spec.streams if definition.of in (stream.signals or ())]
        if definition.by or definition.op not in ("previous", "delta", "follows") or len(having) < 2:
            continue
        message = (
            f"its samples are those of {' and '.join(having)}, one after the other, so that it goes from one stream to "
            f"the other as each speaks; give `{definition.of}` another name at each, or keep it by a signal that tells "
            "them apart, as in `by: robot, forget: 1h`, with `robot: \"'r1'\"` under `signals`"
        )
        path = "derive", definition.name, definition.op
        yield replace(_warning(definition, path, message, None), kind="general")


def _with_itself(definition: Definition, where: Sequence[Place]) -> Iterator[tuple[str, Position]]:
    """Parts of an expression that put a signal together with its own last sample, each with where it begins."""
    for node in tree.walk(definition.expression.tree):
        match node:
            case tree.Compare(left=left, mark=mark, right=right):
                told = _itself(left, mark, right, where)
            case tree.Chain(first=left, rest=((mark, right), *_)):
                told = _itself(left, mark, right, where)
            case _:
                continue
        if told:
            shown = " ".join(definition.of[left.start : right.end].split())
            yield f"`{shown}` {told}", tokens.place(definition.of, left.start)


def _itself(left: tree.Node, mark: str, right: tree.Node, where: Sequence[Place]) -> str:
    """What comes of a signal and its own last, least or largest sample; empty where that is not known."""
    if not (isinstance(left, tree.Path) and isinstance(right, tree.Path)) or mark not in ("-", *_MARKS):
        return ""
    (one,), (other,) = left.names, right.names
    there = [p for p in where if p.has(one) and p.has(other)]
    signs = {p.signs(one, other) or tuple(-sign for sign in p.signs(other, one) or ()) for p in there}
    if len(signs) != 1 or not (ways := signs.pop()):
        return ""
    if mark == "-":
        comes = "is always 0" if ways == (0,) else ""
    else:
        found = {_MARKS[mark](sign, 0) for sign in ways}
        comes = f"is {'always' if found == {True} else 'never'} true" if len(found) == 1 else ""
    asked = Atom((Constraint(one, "==", Any.ANY), Constraint(other, "==", Any.ANY)))
    return comes and comes + counted(asked, there)


def _shape(found: Range) -> Value | None:
    """What is known of a signal with these values, where they are of one kind."""
    if found.is_number and found.has_numbers:
        return (
            Value("real", "number") if found.whole is None or found.kinds or found.values else Value("whole", "int64")
        )
    if found.kinds == {"text"} and found.whole is None and all(isinstance(value, str) for value in found.values):
        return Value("text", "text")
    if found.kinds == {"boolean"} and found.whole is None and not found.values:
        return Value("bool", "Boolean")
    return None


def _may_sample(definition: Definition, place: Place, derived: frozenset[str]) -> bool:
    """Whether an event adds a sample to it, or may move it: what is only held is none."""
    if definition.formulas:
        return any(_may_hold(formula, place) for formula in definition.formulas)
    return definition.of in place.own or place.open or (definition.of in derived and place.has(definition.of))


def _apart(keys: Sequence[str], where: Sequence[Place]) -> str:
    """Who has signals that no event has together, and how to make them last."""
    told = (whose(where, [place for place in where if not place.has(key)], [key]) for key in dict.fromkeys(keys))
    return "; ".join(told)


def _repeated(definition: Definition, formula: Formula, spec: Spec) -> Iterator[tuple[str, Position]]:
    """An event that holds again at each message while signals keep their values, and then moves its machine again."""
    kept = lasting(spec)
    if not _moves_again(definition, formula) or present(formula, without_signals(kept)) is not None:
        return
    last = [a for a in atoms(formula) if any(c.key in kept for c in a.constraints)]
    names = {c.key for atom in last for c in atom.constraints}
    owner = next((str(s.key) for s in spec.streams if names <= {*s.hold}), "the message that it is")
    message = (
        f"`{render(formula)}` comes again at each message while it holds, since {quoted(sorted(names))} "
        f"{'keeps its value' if len(names) == 1 else 'keep their values'}; write it with {owner}, as in "
        "`{topic: …} and …`, if it is to come once"
    )
    yield message, last[0].at


def _moves_again(definition: Definition, formula: Formula) -> bool:
    """Whether an event that comes twice moves the machine elsewhere than where it came first."""
    table = definition.table
    assert table is not None  # noqa: S101 -- it is a machine
    bit = 1 << definition.events.index(formula)
    first = [table.after(state, bit) for state, row in enumerate(table.rows) if bit in row]
    return any(table.after(state, bit) != state for state in first)


def _unfollowed(definition: Definition, where: Sequence[Place]) -> Iterator[SpecProblem]:
    """States of a machine that no value of the signal is which it follows."""
    table = definition.table
    having = [place for place in where if place.has(definition.of)]
    found = range_at(definition.of, having)
    for state in dict.fromkeys(value for value in table.values if value not in (None, table.bad)) if table else ():
        assert state is not None  # noqa: S101 -- such are left out
        if having and not any(found.meets([Constraint(definition.of, "==", value)]) for value in _written_as(state)):
            message = f"no value of `{definition.of}` is the state '{state}': it is always {described(found)}"
            yield _warning(definition, ("derive", definition.name, "states", state), message, None)


def _written_as(state: str) -> Iterator[Scalar]:
    """The values that are written as a state's name."""
    yield state
    with suppress(ValueError):
        value = json.loads(state)
        if is_signal(value) and canonical(value) == state:
            yield value


def _less_than_one(spec: Spec) -> Iterator[SpecProblem]:
    """Rates by which less than one would come in the window: whether any comes is all that can be told by them."""
    derived = {d.name: d for d in spec.derive if d.timed}
    for i, prop in enumerate(spec.properties):
        for atom in prop.atoms:
            for constraint in atom.constraints:
                found = derived.get(constraint.key)
                rate = _rate_asked(prop, constraint, found) if found is not None else None
                if found is None or found.over is None or rate is None or not 0 < rate * found.over < SECOND:
                    continue
                unit = SECOND if rate <= 1 else SECOND // 1_000
                enough = ceil(SECOND / rate / unit) * unit
                message = (
                    f"formula of '{prop.id}': one in {span(found.over)} is {SECOND / found.over:g} Hz already, so that "
                    f"{rate:g} Hz asks only whether any came; take it over {span(enough)}, or more"
                )
                yield SpecProblem(("properties", i, "formula"), message, atom.at, severity="warning")


def _rate_asked(prop: Property, constraint: Constraint, definition: Definition) -> float | None:
    """How many a second a constraint asks for; None where it asks for something else."""
    value = constraint.value
    if definition.op == "rate" and constraint.op not in ("==", "!=") and isinstance(value, float | int):
        return value
    at_most = _AT_MOST.search(prop.text) if definition.op == "count" and definition in prop.measures else None
    return float(at_most[1]) if at_most else None


def _warning(definition: Definition, path: KeyPath, message: str, at: Position | None) -> SpecProblem:
    text = f"derived signal '{definition.name}': {message}"
    return SpecProblem(path, text, at, severity="warning", kind="vacuous")
