"""Warnings of parts that never hold, or never fail: each is so on random traces."""

from __future__ import annotations

import os
import random
from collections.abc import Callable
from dataclasses import replace

import pytest

from oracle_server.core.atoms import canonical
from oracle_server.core.events import StreamKey
from oracle_server.core.expression import check_shape, parse_expression
from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Atom, Constraint, Formula, Scalar
from oracle_server.core.hazards.misfits import Doubt
from oracle_server.core.hazards.places import places
from oracle_server.core.hazards.vacuity import doubts
from oracle_server.core.hazards.worlds import Effort
from oracle_server.core.judging.holding import Held
from oracle_server.core.kinds import RESERVED
from oracle_server.core.plan import constants, plan
from oracle_server.core.ranges import range_of
from oracle_server.core.shapes import Record, Value
from oracle_server.core.signals import Projection
from oracle_server.core.spec import Property, Spec, StreamSpec
from oracle_server.core.typed import StreamTypes, TypedMessage
from tests import generate
from tests.brute import TimedSignals, truths
from tests.strategies import SECOND

CASES = int(os.environ.get("CASES", "700"))
NEVER = tree.Not(Atom(()))
EXPRESSIONS = ("msg.{0}", "msg.{0}", "string(msg.{0})", "msg.{0} > 1", "msg.{0} == 7 ? 'A' : 'B'", "size(msg.{0})", "7")


def rewritten(node: Formula, change: Callable[[Atom], Formula]) -> Formula:
    """A formula with its atoms changed."""

    def part(inner: Formula) -> Formula:
        return rewritten(inner, change)

    match node:
        case Atom():
            return change(node)
        case tree.Not(operand) | tree.Pre(operand) | tree.Once(operand) | tree.Historically(operand):
            return replace(node, operand=part(operand))
        case tree.And(left, right) | tree.Or(left, right) | tree.Implies(left, right) | tree.Since(left, right):
            return replace(node, left=part(left), right=part(right))
        case tree.Exists(_, body) | tree.Forall(_, body):
            return replace(node, body=part(body))
        case _:
            raise AssertionError(node)


FIELDS: dict[str, tuple[Value, tuple[Scalar, ...]]] = {
    "bool": (Value("bool", "bool"), (True, False)),
    "string": (Value("text", "string"), ("A", "B", "7", "")),
    "uint8": (Value("whole", "uint8"), (0, 1, 2, 7, 255)),
    "int8": (Value("whole", "int8"), (-128, 0, 1, 7, 127)),
    "float64": (Value("real", "float64"), (0.0, 1, 7.0, 7.5, -1e300)),
}
"""Kinds of fields, with values that they may have."""


def some_type(rng: random.Random) -> TypedMessage:
    """A type of a few fields, which other distributions may not all have."""
    fields = {key: FIELDS[rng.choice(list(FIELDS))][0] for key in generate.KEYS if rng.random() < 0.9}
    everywhere = {key: value for key, value in fields.items() if rng.random() < 0.8}
    return TypedMessage(Record("x_msgs/msg/X", fields), None, Record("x_msgs/msg/X", everywhere))


def some_spec(rng: random.Random, time: Time) -> tuple[Spec, StreamTypes]:
    """Streams, some of a known type, and a formula over them; half of the values that it asks for are theirs."""
    streams: list[StreamSpec] = []
    types: dict[StreamKey, TypedMessage] = {}
    free = list(generate.KEYS)
    for name, kind in rng.sample([("/a", "topic"), ("/b", "topic"), ("/s", "request"), ("/s", "response")], 3):
        known = some_type(rng) if rng.random() < 0.5 else None
        keys = rng.sample(generate.KEYS, rng.randint(0, 2))
        texts = {key: rng.choice(EXPRESSIONS).format(key) for key in keys}
        if known is not None:
            texts = {key: text for key, text in texts.items() if not check_shape(parse_expression(text), known.shape)}
        signals = texts if rng.random() < (0.85 if known is None else 0.4) else None
        own = keys if signals is None else list(signals)
        hold = frozenset(key for key in own if key in free and rng.random() < 0.2)
        free = [key for key in free if key not in hold]
        stream = StreamSpec(name, kind, type=f"x_msgs/msg/X{len(types)}", signals=signals, hold=hold)  # type: ignore[arg-type]
        streams.append(stream)
        if known is not None:
            types[stream.key] = known

    def change(atom: Atom) -> Atom:
        of = rng.choice(streams)
        more = []
        if rng.random() < 0.5:
            more.append(Constraint(of.traits.group, "==", of.name))
        if rng.random() < 0.2:
            more.append(Constraint("kind", rng.choice(("==", "!=")), of.kind))
        if rng.random() < 0.3:
            wanted = rng.choice((-128, 0, 1, 7, 7.5, 255, 300))
            more.append(Constraint(rng.choice(generate.KEYS), rng.choice(("<", "<=", ">", ">=")), wanted))
        if rng.random() < 0.2:
            more.append(Constraint(rng.choice(generate.KEYS), "==", rng.choice(("A", "B", "C", True, tree.Any.ANY))))
        for _ in range(rng.choice((0, 0, 0, 0, 1, 1, 2))):
            key, other = rng.sample(generate.KEYS, 2)
            more.append(Constraint(key, rng.choice(("<", "<=", ">", ">=")), tree.Signal(other)))
        found = (*more, *atom.constraints) if rng.random() < 0.6 else tuple(more) or atom.constraints
        return Atom((*found, *tree.demanded(found)))

    def worded(atom: Atom) -> Formula:
        return rng.choice((tree.TRUE, tree.FALSE, tree.FIRST)) if rng.random() < 0.05 else change(atom)

    def joined(atom: Atom) -> Atom:
        keys = {key: rng.choice(("topic", "monitor", "kind")) for key, _ in atom.refs if rng.random() < 0.1}
        return Atom(tuple(replace(c, key=keys.get(c.key, c.key)) for c in atom.constraints))

    formula = rewritten(generate.formula(rng, time, rng.randint(0, 4)), lambda a: joined(a) if a.refs else worded(a))
    guards = frozenset(rng.sample([s.name for s in streams], 1))
    return Spec("x", tuple(streams), (Property("p", formula, time=time, guards=guards),)), types


def some_message(rng: random.Random, known: TypedMessage | None) -> dict[str, Scalar | None]:
    if known is None:
        return {k: rng.choice((1, 2, 7, 7.5, "A", "C", True, None)) for k in generate.KEYS if rng.random() < 0.8}
    values = {
        name: rng.choice(next(some for value, some in FIELDS.values() if value == field))
        for name, field in known.shape.fields.items()
    }
    return {name: value for name, value in values.items() if name in known.surest.fields or rng.random() < 0.5}


def some_trace(rng: random.Random, spec: Spec, types: StreamTypes, size: int) -> tuple[list[TimedSignals], list[str]]:
    """The steps of random messages, as one monitor reports them, and the stream of each."""
    ready, held, now = plan(spec), Held(), 0
    steps: list[TimedSignals] = []
    names: list[str] = []
    while len(steps) < size:
        now += rng.choice((0, 1, SECOND, 2 * SECOND))
        stream = rng.choice(spec.streams)
        own, failed = ready.streams[stream.key].project(some_message(rng, types.get(stream.key)))
        if failed and stream.key in types:
            continue
        signals: dict[str, Scalar] = {**own, **constants(stream), "monitor": "m"}
        if stream.traits.has_call and rng.random() < 0.5:
            signals["call"] = 7
        for name in stream.hold:
            held.values.pop(name, None)
            if name in own:
                held.values[name] = own[name]
        steps.append((now, {**held.values, **signals}))
        names.append(str(stream.key))
    return steps, names


def holds(doubt: Doubt, prop: Property, steps: list[TimedSignals], names: list[str]) -> bool:
    """Whether what a warning claims is so on a trace."""

    def of(formula: Formula) -> list[bool]:
        return truths(formula, steps, prop.time)

    match doubt.claim:
        case "never":
            return not any(of(opened(doubt.part)))
        case "met":
            return met(doubt.part, steps)
        case "apart":
            return apart(doubt.part, prop.formula, steps)
        case "spanned":
            one, _ = tree.children(doubt.part)
            assert isinstance(one, Atom)
            there = Atom(
                tuple(c if c.key in RESERVED else replace(c, op="==", value=tree.Any.ANY) for c in one.constraints)
            )
            return all(held or not here for held, here in zip(of(doubt.part), of(there), strict=True))
        case "idle":
            return of(without(prop.formula, doubt.part)) == of(prop.formula)
        case _:
            part = of(opened(doubt.part))
            return all(part[i] is (doubt.claim == "true") for i, name in enumerate(names) if name in doubt.where)


def without(node: Formula, part: Formula) -> Formula:
    """A formula with `false` for one of its parts."""
    return NEVER if node is part else tree.rebuilt(node, lambda inner: without(inner, part))


def opened(part: Formula) -> Formula:
    """A part by itself: what its variables may be is left open, but for those of its own quantifiers."""
    own = {node.variable for node in tree.walk(part) if isinstance(node, tree.Exists | tree.Forall)}

    def any_of(constraint: Constraint) -> Constraint:
        free = isinstance(constraint.value, tree.Ref) and constraint.value.name not in own
        return replace(constraint, value=tree.Any.ANY) if free else constraint

    return rewritten(part, lambda atom: Atom(tuple(any_of(c) for c in atom.constraints)))


def met(part: Formula, steps: list[TimedSignals]) -> bool:
    """Whether one constraint of an atom never fails where the atom's signals are there, on its own streams."""
    assert isinstance(part, Atom)
    unequal = [c for c in part.constraints if c.op != "==" and c.key not in RESERVED]
    present = Atom(tuple(c if c.key in RESERVED else Constraint(c.key, "==", tree.Any.ANY) for c in part.constraints))
    there = truths(opened(present), steps, "steps")
    return any(all(truths(Atom((c,)), steps, "steps")[i] for i, here in enumerate(there) if here) for c in unequal)


def apart(part: Formula, formula: Formula, steps: list[TimedSignals]) -> bool:
    """Whether some variable of an atom has no value there that it has at any other atom below its quantifier."""
    for node in tree.walk(formula):
        if not isinstance(node, tree.Exists | tree.Forall) or all(below is not part for below in tree.walk(node)):
            continue
        uses = uses_of(node.variable, node.body)
        for use in (u for u in uses if u[0] is part):
            others = [bound(other, steps) for other in uses if other is not use]
            if others and not any(bound(use, steps) & values for values in others):
                return True
    return False


def uses_of(variable: str, node: Formula) -> list[tuple[Atom, str]]:
    """The atoms and signals that a variable stands in, but for where another quantifier takes its name."""
    if isinstance(node, Atom):
        return [(node, key) for key, name in node.refs if name == variable]
    if isinstance(node, tree.Exists | tree.Forall) and node.variable == variable:
        return []
    return [use for child in tree.children(node) for use in uses_of(variable, child)]


def bound(use: tuple[Atom, str], steps: list[TimedSignals]) -> set[str]:
    """The values to which an atom binds a signal on a trace."""
    atom, key = use
    there = truths(opened(atom), steps, "steps")
    return {canonical(signals[key]) for (_, signals), here in zip(steps, there, strict=True) if here}


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_what_is_warned_of_is_so(time: Time) -> None:
    told: dict[str, int] = {}
    for number in range(CASES):
        rng = random.Random(f"{time} {number}")
        spec, types = some_spec(rng, time)
        (prop,) = spec.properties
        found = list(doubts(prop, places(spec, prop.time, types), Effort()))
        for doubt in found:
            told[doubt.claim] = told.get(doubt.claim, 0) + 1
        for _ in range(4 if found else 0):
            steps, names = some_trace(rng, spec, types, rng.randint(3, 12))
            for doubt in found:
                case = f"{number}: {render(prop.formula, time)}\n{doubt.message}\n{steps}"
                assert holds(doubt, prop, steps, names), case
    assert {claim for claim, count in told.items() if count > 2} >= {"never", "met", "apart", "idle", "false"}


def test_values_are_those_that_expressions_give() -> None:
    inner = ("msg.a", "string(msg.a)", "'A'", "7", "-7", "1.5", "true", "null", "size(msg.a)", "int(msg.a)", "msg.a[0]")
    rng = random.Random(7)
    told = 0
    for _ in range(CASES):
        text = _expression(rng, 3, inner)
        found = range_of(text)
        try:
            project = Projection({"v": text})
        except Exception:  # noqa: BLE001 -- not every random text is an expression
            continue
        for a in (1, 2.5, "A", "7", True, [1, "A"], {"x": 1}, None):
            for value in project({"a": a, "b": a})[0].values():
                told += 1
                assert found.meets([Constraint("v", "==", value)]), text
    assert told > CASES


def _expression(rng: random.Random, depth: int, inner: tuple[str, ...]) -> str:
    def part() -> str:
        return _expression(rng, depth - 1, inner)

    if depth == 0 or rng.random() < 0.2:
        return rng.choice(inner)
    forms = (
        *("{0} ? {1} : {2}", "({0} == {1}) ? {2} : {3}", "{0} == {1}", "{0} && {1}", "!{0}", "({0})", "{0} + {1}"),
        *("string({0})", "-{0}", "{0} in [{1}]", "{0} - {1}", "size({0}) * 2", "double({0})", "{0}.size()"),
        "{0}.contains({1})",
    )
    form = rng.choice(forms)
    return form.format(part(), part(), part(), part())
