"""What `check` refuses or warns of: specs that can be read, but would not work as intended."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from oracle_server.core.deadlocks import deadlocks, starvation
from oracle_server.core.dependencies import GraphNode
from oracle_server.core.errors import ExpressionError, SpecProblem
from oracle_server.core.events import StreamKey
from oracle_server.core.expression import MAX_PATTERNS, Expression, check_shape, parse_expression, too_dear
from oracle_server.core.fields import inspect_fields
from oracle_server.core.kinds import RESERVED
from oracle_server.core.signals import UNWRITTEN
from oracle_server.core.spec import Spec, StreamSpec
from oracle_server.core.typed import StreamTypes
from oracle_server.core.unmet import has_signal, unmet
from oracle_server.core.vacuity import vacuous
from oracle_server.core.withholding import mendable


def inspect(
    spec: Spec, graph: Sequence[GraphNode] | None = None, types: StreamTypes | None = None
) -> list[SpecProblem]:
    """Everything that is wrong or doubtful in a spec that could be read, on a robot of this graph and these types.

    Without `types` nothing is said of fields; a stream whose type is not known has none in them.
    """
    found = [
        *_duplicates(spec),
        *_signals(spec),
        *_expressions(spec),
        *_held_elsewhere(spec),
        *_unwritten(spec),
        *_filters(spec),
        *_idle_keys(spec),
        *_guards(spec),
        *_external(spec),
        *unmet(spec),
        *_gaps(spec),
        *_causes(spec),
        *deadlocks(spec, graph),
        *(starvation(spec, graph) if graph is not None else ()),
        *_undoing(spec),
        *(inspect_fields(spec, types) if types is not None else ()),
    ]
    if any(problem.severity == "error" for problem in found):
        return found
    return [*found, *vacuous(spec, types or {})]


def _duplicates(spec: Spec) -> Iterator[SpecProblem]:
    seen: dict[StreamKey, int] = {}
    names: dict[str, tuple[str, int]] = {}
    for i, stream in enumerate(spec.streams):
        if not stream.traits.leads:
            continue
        group = stream.traits.group
        first, at = names.setdefault(stream.name, (group, i))
        if seen.setdefault(stream.key, i) != i or first != group:
            message = f"'{stream.name}' stands here a second time"
            yield SpecProblem(("streams", i, group), message, first=("streams", at, first))
    ids: dict[str, int] = {}
    for i, prop in enumerate(spec.properties):
        at = ids.setdefault(prop.id, i)
        if at != i:
            message = f"the id '{prop.id}' stands here a second time"
            yield SpecProblem(("properties", i, "id"), message, first=("properties", at, "id"))


def _signals(spec: Spec) -> Iterator[SpecProblem]:
    holders: dict[str, str] = {}
    for i, stream in enumerate(spec.streams):
        for name in stream.signals or {}:
            if name in RESERVED:
                path = ("streams", i, "signals", name)
                yield SpecProblem(path, f"the signal '{name}' is reserved; give yours another name")
        for name in sorted(stream.hold):
            if stream.signals is not None and name not in stream.signals:
                yield SpecProblem(("streams", i, "hold"), f"'{name}' is held, but is no signal of {stream.key}")
            if name in RESERVED:
                yield SpecProblem(("streams", i, "hold"), f"the signal '{name}' is reserved and can't be held")
            if holders.setdefault(name, str(stream.key)) != str(stream.key):
                yield SpecProblem(("streams", i, "hold"), f"'{name}' is held by {holders[name]} already")


def _expressions(spec: Spec) -> Iterator[SpecProblem]:
    patterns = 0
    for i, stream in enumerate(spec.streams):
        expressions: dict[str, Expression] = {}
        for name, text in (stream.signals or {}).items():
            path = ("streams", i, "signals", name)
            try:
                expressions[name] = parse_expression(text)
            except ExpressionError as error:
                yield SpecProblem(path, f"signal '{name}': {error.message}", (error.line, error.column))
                continue
            for problem in check_shape(expressions[name], None) if text != UNWRITTEN else ():
                yield SpecProblem(path, f"signal '{name}': {problem.message}", problem.within, problem.severity)
        dear = too_dear(expressions)
        if dear is not None:
            yield SpecProblem(("streams", i, "signals"), dear)
        patterns += sum(expression.patterns for expression in expressions.values())
    if patterns > MAX_PATTERNS:
        yield SpecProblem(("streams",), f"the spec has {patterns} patterns for `matches`, and may have {MAX_PATTERNS}")


def _held_elsewhere(spec: Spec) -> Iterator[SpecProblem]:
    """Signals that another stream holds: a warning, since histories may have sessions with such specs."""
    holders = {name: stream.key for stream in spec.streams for name in stream.hold}
    for i, stream in enumerate(spec.streams):
        for name in sorted(n for n in stream.signals or () if n in holders and n not in stream.hold):
            message = (
                f"'{name}' is a signal of {stream.key}, and held by {holders[name]}: formulas see what is held "
                f"at every event of {stream.key} that lacks its own; give one of them another name"
            )
            yield SpecProblem(("streams", i, "signals", name), message, severity="warning")


def _unwritten(spec: Spec) -> Iterator[SpecProblem]:
    """Signals that `import` left to be written: a warning, since what reads them is unknown and nothing worse."""
    places: dict[str, int] = {}
    for i, stream in enumerate(spec.streams):
        for name, text in (stream.signals or {}).items():
            if text == UNWRITTEN:
                places.setdefault(name, i)
    readers: dict[str, list[str]] = {}
    for prop in spec.properties if places else ():
        for key in {c.key for atom in prop.atoms for c in atom.constraints} & places.keys():
            readers.setdefault(key, []).append(prop.id)
    for name, i in places.items():
        read = readers.get(name)
        if read:
            message = (
                f"'{name}' is still to be written ({UNWRITTEN} always fails), so that {', '.join(read)} is unknown"
            )
            yield SpecProblem(("streams", i, "signals", name), message, severity="warning")


def _filters(spec: Spec) -> Iterator[SpecProblem]:
    guarded = frozenset[str]().union(*(p.guards for p in spec.properties))
    max_delay = spec.ordering.max_delay
    for i, stream in enumerate(spec.streams):
        if stream.action != "filter" or not stream.traits.leads:
            continue
        if stream.name not in guarded:
            yield SpecProblem(
                ("streams", i, "action"),
                f"{stream.name} is filtered, but no property guards it; name it under `guards`",
            )
        if stream.ordered and spec.ordering.by != "arrival":
            if max_delay is not None and stream.decide_within <= max_delay:
                yield SpecProblem(
                    ("streams", i, "decide_within"),
                    f"decide_within of {stream.name} must exceed max_delay, for which an event may wait for older ones",
                )
            if max_delay is None:
                message = f"with `max_delay: none` a decision on {stream.name} can take longer than decide_within"
                yield SpecProblem(("streams", i, "decide_within"), message, severity="warning")


def _idle_keys(spec: Spec) -> Iterator[SpecProblem]:
    """Keys that say what becomes of decided messages, where none is decided; their defaults are as good as absent."""
    usual = StreamSpec("")
    for i, stream in enumerate(spec.streams):
        if stream.action == "filter" or not stream.traits.leads:
            continue
        for key in ("on_deny", "on_unavailable", "decide_within", "intercept"):
            if getattr(stream, key) != getattr(usual, key):
                message = (
                    f"`{key}` has no effect on {stream.name}, which is only logged: nothing of it is denied; "
                    "write `action: filter`, and name it under `guards` of a property, or leave the key out"
                )
                yield SpecProblem(("streams", i, key), message, severity="warning")


def _guards(spec: Spec) -> Iterator[SpecProblem]:
    by_name = {stream.name: stream for stream in spec.streams}
    for i, prop in enumerate(spec.properties):
        path = ("properties", i, "guards")
        for name in sorted(prop.guards):
            stream = by_name.get(name)
            if stream is None:
                yield SpecProblem(path, f"property '{prop.id}' guards '{name}', which is no stream of this spec")
            elif stream.action != "filter":
                yield SpecProblem(
                    path, f"property '{prop.id}' guards {name}, whose action is `log`: it could deny nothing"
                )
            elif prop.blame == "any" and not (prop.numeric or prop.external) and not mendable(spec, prop, name):
                yield SpecProblem(
                    path,
                    f"property '{prop.id}' can be negative at an event of {name} that withholding would not mend: "
                    "it would then deny what is not to blame; `blame: caused` denies only what withholding mends",
                    severity="warning",
                )


def _external(spec: Spec) -> Iterator[SpecProblem]:
    for i, prop in enumerate(spec.properties):
        if prop.external is None:
            continue
        received = prop.external.streams
        for name in sorted(received or ()):
            if name not in spec.names:
                yield SpecProblem(("properties", i, "streams"), f"'{name}' is no stream of this spec")
        for name in sorted(prop.guards & spec.names):
            if received is not None and name not in received:
                message = f"'{prop.id}' guards {name}, which its oracle does not receive; name it under `streams`"
                yield SpecProblem(("properties", i, "streams"), message)
        for j, stream in enumerate(spec.streams):
            ordered = stream.ordered and spec.ordering.by != "arrival"
            waits = prop.external.timeout + ((spec.ordering.max_delay or 0) if ordered else 0)
            if stream.action == "filter" and stream.traits.leads and stream.decide_within <= waits:
                message = (
                    f"decide_within of {stream.name} must exceed {'max_delay and ' if ordered else ''}the timeout of "
                    f"'{prop.id}', since every decision after an event that its oracle receives waits for the oracle"
                )
                yield SpecProblem(("streams", j, "decide_within"), message)


def _gaps(spec: Spec) -> Iterator[SpecProblem]:
    """The streams at whose events a formula over numbers lacks some."""
    held = frozenset[str]().union(*(s.hold for s in spec.streams))
    for i, prop in enumerate(spec.properties):
        if not prop.numeric:
            continue
        named = [c.key for atom in prop.atoms for c in atom.constraints]
        read = [key for key in named if any(has_signal(s, key, held) for s in spec.streams)]
        lacking = {str(s.key): [key for key in read if not has_signal(s, key, held)] for s in spec.streams}
        where = ", ".join(f"{stream} ({', '.join(keys)})" for stream, keys in lacking.items() if keys)
        if where:
            message = f"property '{prop.id}' is unknown where a signal is missing: {where}; `hold` keeps the last value"
            yield SpecProblem(("properties", i, "formula"), message, severity="warning")


def _causes(spec: Spec) -> Iterator[SpecProblem]:
    names = {s.name for s in spec.streams}
    for i, stream in enumerate(spec.streams):
        for name in stream.causes:
            if name not in names and stream.traits.leads:
                message = f"{stream.name} causes '{name}', which is no stream of this spec"
                yield SpecProblem(("streams", i, "causes"), message)


def _undoing(spec: Spec) -> Iterator[SpecProblem]:
    for i, stream in enumerate(spec.streams):
        if stream.on_deny != "undo" or not stream.traits.leads:
            continue
        path = ("streams", i, "on_deny")
        if stream.intercept == "subscriber":
            yield SpecProblem(
                path, "`undo` is for what no one has seen: requests, and topics with `intercept: publisher`"
            )
        if spec.ordering.by == "both":
            yield SpecProblem(
                path, "`undo` needs one order: `by: both` judges an event by arrival before it is decided"
            )
        if stream.on_unavailable == "pass":
            yield SpecProblem(path, "`undo` needs `on_unavailable: deny`: what passed without a decision did happen")
