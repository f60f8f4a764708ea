"""What `check` refuses or warns of in derived signals, and in what formulas ask of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Literal

from oracle_server.core.derived.compared import uncompared
from oracle_server.core.derived.definition import MAX_SAMPLES, OPS, Definition
from oracle_server.core.derived.keyed import names_of
from oracle_server.core.derived.machinery import KeyPath, machine_problems, never, never_wrong, placed
from oracle_server.core.derived.ranges import derived_ranges
from oracle_server.core.errors import ExpressionError, SpecProblem
from oracle_server.core.expression import KEYWORDS, check_shape
from oracle_server.core.expression.tokens import place
from oracle_server.core.expression.tree import Path, walk
from oracle_server.core.formula import tree
from oracle_server.core.formula.render import render_atom
from oracle_server.core.formula.tree import Atom, Constraint, Position, Ref
from oracle_server.core.hazards.unmet import why_never
from oracle_server.core.kinds import OWN, RESERVED
from oracle_server.core.nearest import listed, nearest
from oracle_server.core.ranges import ANYTHING, Range
from oracle_server.core.spec import Spec
from oracle_server.core.units import span

_ORDERS = ("<", "<=", ">", ">=")
_STATE = (Atom, tree.Not, tree.And, tree.Or, tree.Implies)
"""What a formula of one step is made of."""


def derived_problems(spec: Spec) -> Iterator[SpecProblem]:
    """What is wrong or doubtful in the derived signals of a spec."""
    if not spec.derive:
        return
    ranges = derived_ranges(spec)
    for index, definition in enumerate(spec.derive):
        yield from _name(spec, definition)
        yield from _operands(spec, index, definition, ranges)
        yield from _keys(definition)
    yield from _asked(spec, ranges)
    yield from uncompared(spec)
    yield from _too_early(spec)
    yield from _forgotten(spec)
    yield from never_wrong(spec)


def _name(spec: Spec, definition: Definition) -> Iterator[SpecProblem]:
    name, path = definition.name, ("derive", definition.name)
    if name in _reserved(spec):
        yield SpecProblem(path, f"the signal '{name}' is reserved; give yours another name")
    if name in KEYWORDS:
        yield SpecProblem(path, f"`{name}` is a word of expressions; give the derived signal another name")
    for i, stream in enumerate(spec.streams):
        if name in (stream.signals or ()) or name in stream.hold:
            key = "signals" if name in (stream.signals or ()) else "hold"
            first = ("streams", i, key, name) if key == "signals" else ("streams", i, key)
            message = f"'{name}' is a signal of {stream.key} already: give the derived one another name"
            yield SpecProblem(path, message, first=first)
            return


def _operands(spec: Spec, index: int, definition: Definition, ranges: Mapping[str, Range]) -> Iterator[SpecProblem]:
    path = ("derive", definition.name, definition.op)
    if definition.events:
        yield from machine_problems(definition)
    if definition.formulas:
        for within, formula, start in placed(definition):
            yield from _formula(spec, index, definition, formula, within, start)
    elif definition.op == "expression":
        yield from _expression(spec, index, definition, path)
    else:
        reason = _unknown(spec, index, definition.of) or _of_age(spec, definition.of)
        if reason is None and OPS[definition.op].numbers and not ranges.get(definition.of, ANYTHING).has_numbers:
            reason = f"`{definition.op}` takes numbers, and '{definition.of}' is never one"
        if reason is not None:
            yield _problem(definition, path, reason)
    for by in definition.by:
        reason = _unknown(spec, index, by) or _of_age(spec, by)
        if reason is not None:
            yield _problem(definition, ("derive", definition.name, "by"), reason)


def _formula(
    spec: Spec, index: int, definition: Definition, formula: tree.Formula, path: KeyPath, start: Position | None
) -> Iterator[SpecProblem]:
    """What is wrong with a formula that stands at a path; `start` is where in the text, where that names it alone."""
    taker = f"`{definition.op}`" if definition.formula is not None else "an event of a machine"
    for node in tree.walk(formula):
        if not isinstance(node, _STATE):
            found = [n.at for n in tree.walk(node) if isinstance(n, Atom)]
            message = (
                f"{taker} takes what holds at one step: atoms, with `not`, `and`, `or` and `->`; "
                "what looks back, or asks for all values, stands in a property's formula"
            )
            yield _problem(definition, path, message, start or min(found, default=(1, 1)))
            return
    above = frozenset(d.name for d in spec.derive[:index]).union(*(s.hold for s in spec.streams))
    below = {d.name for d in spec.derive[index:]} - above - _declared(spec) - _reserved(spec)
    for atom in tree.atoms(formula):
        reason = next((_below(spec, index, c.key) for c in atom.constraints if c.key in below), None)
        reason = reason or why_never(atom, spec, above)
        if reason is not None:
            yield _problem(definition, path, reason, start or atom.at)


def _expression(spec: Spec, index: int, definition: Definition, path: tuple[str, ...]) -> Iterator[SpecProblem]:
    try:
        expression = definition.expression
    except ExpressionError as error:
        yield _problem(definition, path, error.message, (error.line, error.column))
        return
    told: set[str] = set()
    for node in walk(expression.tree):
        if not isinstance(node, Path) or not node.names or node.names[0] in told:
            continue
        reason = _unknown(spec, index, node.names[0]) or _of_age(spec, node.names[0])
        if reason is not None:
            told.add(node.names[0])
            yield _problem(definition, path, reason, place(definition.of, node.start))
    if not told:
        for problem in check_shape(expression, None):
            yield SpecProblem(path, _text(definition, problem.message), problem.within, problem.severity)


def _unknown(spec: Spec, index: int, name: str) -> str | None:
    """Why a name is no signal that a derived one may read; None where it is."""
    if name in _reserved(spec) or name in {d.name for d in spec.derive[:index]}:
        return None
    declared = _declared(spec)
    below = _below(spec, index, name)
    if below is not None and name not in declared:
        return below
    if name in declared or any(stream.signals is None for stream in spec.streams):
        return None
    known = sorted({*declared, *(d.name for d in spec.derive[:index])})
    hint = nearest(name, known)
    return f"unknown signal '{name}'; {f'{hint} ' if hint else ''}there are {listed(known) or 'none'}"


def _reserved(spec: Spec) -> frozenset[str]:
    """The names that events of the spec's streams have without declaring them."""
    return RESERVED.union(*(OWN[stream.traits.group] for stream in spec.streams))


def _declared(spec: Spec) -> set[str]:
    """The signals that streams name themselves."""
    return {key for stream in spec.streams for key in (*(stream.signals or ()), *stream.hold)}


def _below(spec: Spec, index: int, name: str) -> str | None:
    if name == spec.derive[index].name:
        return f"'{name}' can't be computed of itself: it may use the derived signals above it"
    if name in {d.name for d in spec.derive[index:]}:
        return f"'{name}' is derived further down: put it above, since each may use those above it"
    return None


def _of_age(spec: Spec, name: str) -> str | None:
    if any(d.name == name and d.op == "age" for d in spec.derive):
        return (
            f"'{name}' is an age, which changes all the time and has no samples; compare it in a formula, "
            f"as `{{{name} > 0.5}}`"
        )
    return None


def _keys(definition: Definition) -> Iterator[SpecProblem]:
    if definition.counted and definition.over is not None and definition.over > MAX_SAMPLES:
        message = f"a window holds at most {MAX_SAMPLES:,} samples, not {definition.over:,}"
        yield _problem(definition, ("derive", definition.name, "over"), message)
    windowed = definition.timed or (definition.counted and definition.formula is not None)
    if definition.by and not windowed and definition.forget is None:
        message = (
            f"what is kept by {names_of(definition.by)} is kept for each value to the end of the session; write "
            "`forget: 1h`, so that what was not heard of for so long is forgotten"
        )
        yield _problem(definition, ("derive", definition.name, "by"), message, severity="warning")


def _asked(spec: Spec, ranges: Mapping[str, Range]) -> Iterator[SpecProblem]:
    """Comparisons of derived signals with what they never are."""
    derived = {d.name: d for d in spec.derive}
    for i, prop in enumerate(spec.properties):
        for atom in prop.atoms:
            for constraint in atom.constraints:
                definition = derived.get(constraint.key)
                reason = definition and _misfit(definition, constraint, ranges, numeric=prop.numeric)
                if reason:
                    message = f"formula of '{prop.id}': {reason}"
                    yield SpecProblem(("properties", i, "formula"), message, atom.at)


def _too_early(spec: Spec) -> Iterator[SpecProblem]:
    """Properties that are violated at the begin of each session, since they ask for a rate that is not known yet."""
    rates = {d.name: d for d in spec.derive if d.op == "rate" and not d.by}
    for i, prop in enumerate(spec.properties):
        for atom in _demanded(prop.formula) if rates and not prop.guards else ():
            rate = next((rates[c.key] for c in atom.constraints if c.key in rates), None)
            if rate is None or rate.over is None:
                continue
            told = [c for c in atom.constraints if c.key == rate.name and c.op in (">", ">=")]
            other = {">": "<=", ">=": "<"}
            mend = (
                f"`not {{{rate.name} {other[told[0].op]} {told[0].value}}}`" if told else f"`{{{rate.name}: *}} -> …`"
            )
            message = (
                f"formula of '{prop.id}': `{render_atom(atom)}` is false in the first {span(rate.over)} of a session, "
                f"when '{rate.name}' is not known yet, so that each session begins with a violation; write {mend}"
            )
            yield SpecProblem(("properties", i, "formula"), message, atom.at, severity="warning")


def _demanded(formula: tree.Formula) -> Iterator[Atom]:
    """The atoms that must hold at every step."""
    match formula:
        case Atom():
            yield formula
        case tree.And(left, right):
            yield from _demanded(left)
            yield from _demanded(right)


def _misfit(
    definition: Definition, constraint: Constraint, ranges: Mapping[str, Range], *, numeric: bool
) -> str | None:
    name, text = definition.name, render_atom(Atom((constraint,)))
    if definition.op == "age" and numeric:
        return (
            f"'{name}' is an age, which changes at every instant, and a formula over numbers is judged at steps alone; "
            f"leave `engine` out, and compare it with a number, as `{{{name} < 0.5}}`"
        )
    if definition.op == "age" and isinstance(constraint.value, Ref):
        return f"`{text}` binds another value at every instant; compare '{name}' with a number, as `{{{name} > 0.5}}`"
    if definition.table is not None:
        return never(definition, constraint)
    if isinstance(constraint.value, str | bool) and ranges[name].kinds == {"number"}:
        return f"`{text}` is never met: '{name}' is a number; compare it with one, as `{{{name} > 1}}`"
    return None


def _forgotten(spec: Spec) -> Iterator[SpecProblem]:
    """Limits of ages that none reaches, since what is so old is forgotten, and was never heard of then."""
    lives = {d.name: d.forget for d in spec.derive if d.op == "age" and d.forget is not None}
    asked = (
        (i, prop, atom, c) for i, prop in enumerate(spec.properties) for atom in prop.atoms for c in atom.constraints
    )
    for i, prop, atom, c in asked if lives else ():
        life = lives.get(c.key)
        if life is None or c.op not in _ORDERS or not isinstance(c.value, int | float) or c.value * 10**9 < life:
            continue
        message = (
            f"formula of '{prop.id}': what was not heard of for {span(life)} is forgotten, as if never heard of, so "
            f"that `{render_atom(Atom((c,)))}` can't be told; write a `forget` of '{c.key}' that is longer than the "
            f"{c.value:g} s"
        )
        yield SpecProblem(("properties", i, "formula"), message, atom.at, severity="warning", kind="vacuous")


def _problem(
    definition: Definition,
    path: KeyPath,
    message: str,
    within: Position | None = None,
    severity: Literal["error", "warning"] = "error",
) -> SpecProblem:
    return SpecProblem(path, _text(definition, message), within, severity)


def _text(definition: Definition, message: str) -> str:
    return f"derived signal '{definition.name}': {message}"
