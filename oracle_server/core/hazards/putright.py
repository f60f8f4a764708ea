"""Properties that ask whether the times go back by which messages are put in order, which puts that right before."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from oracle_server.core.errors import SpecProblem
from oracle_server.core.expression import tree
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Atom, Constraint, Position, Relation, Signal, walk
from oracle_server.core.formula.tree import Ref as Variable
from oracle_server.core.hazards.misfits import constraint_text
from oracle_server.core.spec import Property, Spec, StreamSpec
from oracle_server.core.stamps import DEFAULT_PATHS
from oracle_server.core.units import span

_ORDERS = frozenset({"<", "<=", ">", ">="})
_LESS_THAN_A_SECOND = frozenset({"nanosec", "nsec", "nsecs"})


@dataclass(frozen=True, slots=True)
class _Times:
    """The signals that are the times of the order, each with its stream, and what is derived of them."""

    of: Mapping[str, StreamSpec]
    deltas: Mapping[str, str]
    previous: Mapping[str, str]


def put_right(spec: Spec) -> Iterator[SpecProblem]:
    """Warnings about properties of a spec without errors which ask whether the times of its order go back."""
    if spec.ordering.by != "publication" or sum(stream.ordered for stream in spec.streams) == 1:
        return  # one stream alone waits for no other, so that what is older than its last message is late at once
    of = {
        name: stream
        for stream in spec.streams
        for name, text in (stream.signals or {}).items()
        if stream.ordered and "msg." in text and _is_its_time(stream, text)
    }
    if not of:
        return
    derived = {op: {d.name: d.of for d in spec.derive if d.op == op and d.of in of} for op in ("delta", "previous")}
    times = _Times(of, derived["delta"], derived["previous"])
    for i, prop in enumerate(spec.properties):
        for signal, text, at in dict.fromkeys(_asked(prop, times)):
            stream, delay = of[signal], spec.ordering.max_delay
            within = "" if delay is None else f" within `max_delay`, {span(delay)},"
            message = (
                f"formula of '{prop.id}': `{text}` asks whether `{signal}` goes back, by which messages of "
                f"{stream.key} are put in order: what the order puts right{within} is not found; write "
                "`ordering: {by: arrival}`, in a spec of its own"
            )
            yield SpecProblem(("properties", i, "formula"), message, at, severity="warning")


def _asked(prop: Property, times: _Times) -> Iterator[tuple[str, str, Position]]:
    """Where a property asks so: the signal, how it is written, and its place."""
    bound = {name: key for atom in prop.atoms for key, name in atom.refs if key in times.of}
    for node in walk(prop.formula):
        if isinstance(node, Atom):
            for constraint in node.constraints:
                signal = _compared(constraint, times)
                if signal is not None:
                    yield signal, constraint_text(constraint), node.at
        if isinstance(node, Relation) and node.op in _ORDERS:
            sides = [bound.get(side.name) for side in (node.left, node.right) if isinstance(side, Variable)]
            if len(sides) > 1 and sides[0] is not None and sides[0] == sides[1]:
                yield sides[0], render(node), node.at


def _compared(constraint: Constraint, times: _Times) -> str | None:
    """The signal of which a constraint asks whether it goes back, None where it does not."""
    key, value = constraint.key, constraint.value
    if constraint.op not in _ORDERS:
        return None
    if isinstance(value, Signal):
        return next((a for a, b in ((key, value.name), (value.name, key)) if times.previous.get(b) == a), None)
    return times.deltas.get(key) if isinstance(value, int | float) and value == 0 else None


def _is_its_time(stream: StreamSpec, text: str) -> bool:
    """Whether a signal is the time by which messages of its stream are ordered, in any unit."""
    path = tuple((stream.stamp.field if stream.stamp is not None else DEFAULT_PATHS[0]).split("."))
    found = list(tree.walk(stream.read(text).tree))
    paths = [node.names for node in found if isinstance(node, tree.Path)]
    computed = all(isinstance(node, tree.Path | tree.Literal | tree.Chain) or _converts(node) for node in found)
    plain = all(
        mark != "%" and (mark != "-" or isinstance(node, tree.Literal))
        for chain in found
        if isinstance(chain, tree.Chain)
        for mark, node in chain.rest
    )
    whole = any(names[-1] not in _LESS_THAN_A_SECOND for names in paths)
    return computed and plain and whole and all(names[: len(path)] == path for names in paths)


def _converts(node: tree.Node) -> bool:
    return isinstance(node, tree.Call) and node.name in ("double", "int")
