"""What `check` refuses or warns of: specs that can be read, but would not work as intended."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from oracle_server.core.errors import ExpressionError, SpecProblem
from oracle_server.core.events import StreamKey
from oracle_server.core.expression import (
    MAX_PATTERNS,
    Expression,
    check_rows,
    check_shape,
    idle,
    parse_expression,
    too_dear,
)
from oracle_server.core.hazards.actions import action_hazards
from oracle_server.core.hazards.attempts import attempts
from oracle_server.core.hazards.awaited import awaited, waits
from oracle_server.core.hazards.calledtwice import called_twice, spelt_twice
from oracle_server.core.hazards.copied import asked_twice, read_twice
from oracle_server.core.hazards.deadlocks import deadlocks, starvation
from oracle_server.core.hazards.dependencies import GraphNode
from oracle_server.core.hazards.derived import derived_problems
from oracle_server.core.hazards.doubts import doubtful_derived
from oracle_server.core.hazards.fields import inspect_fields
from oracle_server.core.hazards.gaps import gaps
from oracle_server.core.hazards.grouped import grouped
from oracle_server.core.hazards.halves import halves
from oracle_server.core.hazards.held import held_elsewhere, held_of_rows
from oracle_server.core.hazards.incomparable import incomparable
from oracle_server.core.hazards.lapsing import lapsing
from oracle_server.core.hazards.mingled import mingled
from oracle_server.core.hazards.moved import moved_on
from oracle_server.core.hazards.namesakes import namesakes
from oracle_server.core.hazards.opening import always_before, at_the_beginning, ever, ever_before
from oracle_server.core.hazards.putright import put_right
from oracle_server.core.hazards.ros import odd_names, twins_left_open
from oracle_server.core.hazards.silence import unseen_silence
from oracle_server.core.hazards.unmet import idle_exclusions, unmet
from oracle_server.core.hazards.vacuity import vacuous
from oracle_server.core.hazards.withholding import mendable
from oracle_server.core.judging.lingering import lingers
from oracle_server.core.kinds import OWN
from oracle_server.core.nearest import either, listed, near, nearest
from oracle_server.core.spec import Spec, StreamSpec
from oracle_server.core.typed import StreamTypes
from oracle_server.core.units import span

UNDO_BY_BOTH = "`undo` needs one order: `by: both` judges an event by arrival before it is decided"


def inspect(
    spec: Spec, graph: Sequence[GraphNode] | None = None, types: StreamTypes | None = None
) -> list[SpecProblem]:
    """Everything that is wrong or doubtful in a spec that could be read, on a robot of this graph and these types.

    Without `types` nothing is said of fields; a stream whose type is not known has none in them.
    """
    found = [
        *_duplicates(spec),
        *odd_names(spec),
        *twins_left_open(spec),
        *called_twice(spec),
        *spelt_twice(spec),
        *_signals(spec),
        *_expressions(spec),
        *held_elsewhere(spec),
        *held_of_rows(spec),
        *_unwritten(spec),
        *_filters(spec),
        *_idle_keys(spec),
        *_guards(spec),
        *_external(spec),
        *awaited(spec),
        *derived_problems(spec),
        *unmet(spec),
        *(idle_exclusions(spec) if types is not None else ()),
        *_causes(spec),
        *deadlocks(spec, graph),
        *(starvation(spec, graph) if graph is not None else ()),
        *_undoing(spec),
        *action_hazards(spec),
        *(replace(p, kind="type") for p in (inspect_fields(spec, types) if types is not None else ())),
    ]
    if all(problem.severity != "error" or problem.path[0] != "streams" for problem in found):
        found += incomparable(spec, types or {})
    if any(problem.severity == "error" for problem in found):
        return found
    known = types or {}
    vacuity = list(vacuous(spec, known))
    told = {(problem.path, problem.within) for problem in vacuity}
    return [
        *found,
        *doubtful_derived(spec, known),
        *asked_twice(spec),
        *read_twice(spec, known),
        *at_the_beginning(spec),
        *ever(spec),
        *attempts(spec),
        *ever_before(spec),
        *always_before(spec),
        *grouped(spec),
        *halves(spec, known),
        *unseen_silence(spec),
        *gaps(spec, known),
        *namesakes(spec, known),
        *mingled(spec, known),
        *put_right(spec),
        *moved_on(spec, known),
        *(problem for problem in lapsing(spec, known) if (problem.path, problem.within) not in told),
        *vacuity,
    ]


def _duplicates(spec: Spec) -> Iterator[SpecProblem]:
    seen: dict[StreamKey, int] = {}
    names: dict[str, tuple[str, int]] = {}
    for i, stream in enumerate(spec.streams):
        if not stream.leads:
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
            if name in OWN[stream.traits.group]:
                path = ("streams", i, "signals", name)
                yield SpecProblem(path, f"the signal '{name}' is reserved; give yours another name")
        for name in sorted(stream.hold):
            if not stream.declares(name):
                message = f"'{name}' is held, but is no signal of {stream.key}; {_instead_of_held(spec, stream, name)}"
                yield SpecProblem(("streams", i, "hold"), message)
            if name in OWN[stream.traits.group]:
                yield SpecProblem(("streams", i, "hold"), f"the signal '{name}' is reserved and can't be held")
            if holders.setdefault(name, str(stream.key)) != str(stream.key):
                yield SpecProblem(("streams", i, "hold"), f"'{name}' is held by {holders[name]} already")


def _instead_of_held(spec: Spec, stream: StreamSpec, name: str) -> str:
    """What to write for a name under `hold` that is no signal of its stream."""
    owners = [str(other.key) for other in spec.streams if name in (other.signals or {})]
    if owners:
        return f"{either(owners)} has it: name it under `hold` there"
    known = sorted(stream.signals or ())
    hint = nearest(name, known)
    return f"{f'{hint} ' if hint else ''}it has {listed(known) or 'none'}"


def _expressions(spec: Spec) -> Iterator[SpecProblem]:
    patterns = 0
    for i, stream in enumerate(spec.streams):
        expressions: dict[str, Expression] = {}
        unread = False
        for problem in _rows(spec, i):
            yield problem
            unread = unread or problem.within is not None
        if unread:
            continue
        for name, text in (stream.signals or {}).items():
            path = ("streams", i, "signals", name)
            try:
                expressions[name] = stream.read(text)
            except ExpressionError as error:
                message = _other_signal(spec, text, error) or error.message
                yield SpecProblem(path, f"signal '{name}': {message}", (error.line, error.column))
                continue
            for found in check_shape(expressions[name], None):
                yield SpecProblem(path, f"signal '{name}': {found.message}", found.within, found.severity)
            same = idle(expressions[name])
            if same is not None:
                yield SpecProblem(path, f"signal '{name}': {same}", severity="warning")
        dear = too_dear(expressions)
        if dear is not None:
            yield SpecProblem(("streams", i, "signals"), dear)
        patterns += sum(expression.patterns for expression in expressions.values())
    if patterns > MAX_PATTERNS:
        yield SpecProblem(("streams",), f"the spec has {patterns} patterns for `matches`, and may have {MAX_PATTERNS}")


def _rows(spec: Spec, i: int) -> Iterator[SpecProblem]:
    """What is wrong with the rows of a stream; with a place within their expression where that can't be used."""
    stream, path = spec.streams[i], ("streams", i, "each")
    if stream.each is None:
        return
    try:
        for found in check_rows(parse_expression(stream.each), None):
            yield SpecProblem(path, f"`each`: {found.message}", found.within, found.severity)
    except ExpressionError as error:
        yield SpecProblem(path, f"`each`: {error.message}", (error.line, error.column))
    if stream.signals is None:
        message = "`each` needs `signals`, which say what formulas see of an element, as `signals: {name: item.name}`"
        yield SpecProblem(path, message)
    if stream.action == "filter":
        why = f"{stream.key} is filtered, and a message passes or not as a whole"
        yield SpecProblem(path, f"{why}; leave `each` out, or write `action: log`")
    for prop in spec.properties:
        if prop.external is not None and prop.external.receives(stream):
            why = f"{stream.key} goes to the external oracle of '{prop.id}', which gets whole messages"
            yield SpecProblem(path, f"{why}; leave `each` out, or name other streams under its `streams`")


def _other_signal(spec: Spec, text: str, error: ExpressionError) -> str:
    """What to say of an expression that can't be read where it has the name of a signal, empty where it has not."""
    word = re.match(r"[A-Za-z_]\w*", text.split("\n")[error.line - 1][error.column - 1 :])
    owners = [str(s.key) for s in spec.streams if word and word[0] in (s.signals or {})]
    if not word or not owners or not error.message.startswith("unknown name"):
        return ""
    told = f"unknown name '{word[0]}', which is a signal of {either(owners)}"
    return f"{told}: an expression reads the fields of its own `msg` alone; put signals together in a formula"


def _unwritten(spec: Spec) -> Iterator[SpecProblem]:
    """Signals that are still to be written, each once: warnings, since what reads them is unknown and nothing worse."""
    places: dict[str, list[int]] = {}
    for i, stream in enumerate(spec.streams):
        for name, text in (stream.signals or {}).items():
            if "todo" in text and _is_unwritten(stream, text):
                places.setdefault(name, []).append(i)
    readers: dict[str, list[str]] = {}
    for prop in spec.properties if places else ():
        for key in {c.key for atom in prop.atoms for c in atom.constraints} & places.keys():
            readers.setdefault(key, []).append(prop.id)
    for name, (first, *others) in places.items():
        told = f"'{name}' is still to be written: `todo()` has no value"
        if others:
            told += f", here and at {listed(str(spec.streams[i].key) for i in others)}"
        if name in readers:
            told += f", so that {', '.join(readers[name])} is unknown"
        yield SpecProblem(("streams", first, "signals", name), told, severity="warning", kind="unjudged")


def _is_unwritten(stream: StreamSpec, text: str) -> bool:
    try:
        return stream.read(text).unwritten
    except ExpressionError:
        return False  # found by `_expressions`


def _filters(spec: Spec) -> Iterator[SpecProblem]:
    guarded = frozenset[str]().union(*(p.guards for p in spec.properties))
    meant = {_stream_meant(name, spec) for name in guarded - spec.names}
    """Streams whose guards are misspelt: of those that is told."""
    max_delay = spec.ordering.max_delay
    for i in sorted(spec.filtered.values()):
        stream = spec.streams[i]
        if stream.name not in guarded | meant:
            message = (
                f"{stream.name} is filtered, but no property guards it, so that it could deny nothing; name it in a "
                f"property, as `guards: [{stream.name}]`"
            )
            yield SpecProblem(("streams", i, "action"), message)
        if stream.ordered and spec.ordering.by != "arrival":
            if max_delay is not None and stream.decide_within <= max_delay:
                message = (
                    f"decide_within of {stream.name} is {span(stream.decide_within)}, and must exceed max_delay, "
                    f"{span(max_delay)}, for which an event may wait for older ones; "
                    f"write `decide_within: {span(max_delay + 10**9)}`, or less for `max_delay` under `ordering`"
                )
                yield SpecProblem(("streams", i, "decide_within"), message)
            if max_delay is None:
                message = f"with `max_delay: none` a decision on {stream.name} can take longer than decide_within"
                yield SpecProblem(("streams", i, "decide_within"), message, severity="warning")


def _idle_keys(spec: Spec) -> Iterator[SpecProblem]:
    """Keys that say what becomes of decided messages, where none is decided; their defaults are as good as absent."""
    usual = StreamSpec("")
    for i, stream in enumerate(spec.streams):
        if stream.name in spec.filtered or not stream.leads:
            continue
        for key in ("on_deny", "on_unavailable", "decide_within", "intercept"):
            if getattr(stream, key) != getattr(usual, key):
                message = (
                    f"`{key}` has no effect on {stream.name}, which is only logged: nothing of it is denied; "
                    "write `action: filter`, and name it under `guards` of a property, or leave the key out"
                )
                yield SpecProblem(("streams", i, key), message, severity="warning")


def _guards(spec: Spec) -> Iterator[SpecProblem]:
    for i, prop in enumerate(spec.properties):
        path = ("properties", i, "guards")
        for name in sorted(prop.guards):
            if name not in spec.names:
                yield SpecProblem(path, f"property '{prop.id}' guards '{name}', {_no_stream(name, spec)}")
            elif name not in spec.filtered:
                yield SpecProblem(
                    path,
                    f"property '{prop.id}' guards {name}, whose action is `log`, so that nothing of it can be denied; "
                    f"write `action: filter` at {name}, or leave the guard out",
                )
            elif (
                prop.blame == "any"
                and not prop.blame_given
                and not (prop.numeric or prop.external)
                and not waits(prop)
                and not mendable(spec, prop, name)
            ):
                caused = "`blame: caused` denies"
                if lingers(spec, prop, name):
                    caused = f"`blame: caused` at the property and `on_deny: undo` at {name} deny"
                yield SpecProblem(
                    path,
                    f"property '{prop.id}' can be negative at an event of {name} that withholding would not mend: "
                    f"it would then deny what is not to blame; {caused} only what withholding mends, "
                    "and `blame: any` says that it is meant",
                    severity="warning",
                )
            elif prop.blame == "caused" and lingers(spec, prop, name) and not mendable(spec, prop, name):
                yield SpecProblem(
                    ("properties", i, "blame"),
                    f"property '{prop.id}' looks back at {name}, of which a denied event has happened all the same: as "
                    "long as it stays negative after one, it may deny what withholding would not mend, since that "
                    f"one may be the reason; write `on_deny: undo` at {name}, so that what is denied never happened, "
                    "or `blame: any`",
                    severity="warning",
                )


def _no_stream(name: str, spec: Spec) -> str:
    """What to say of a name that should be that of a stream."""
    names = sorted(spec.names)
    meant = _stream_meant(name, spec)
    if meant and name.removesuffix("_mon") == meant:
        return f"which is no stream of this spec, but a name on the far side of its monitor; write `{meant}`"
    hint = nearest(name, names)
    return f"which is no stream of this spec; {f'{hint} ' if hint else ''}the streams are {listed(names)}"


def _stream_meant(name: str, spec: Spec) -> str | None:
    """The stream that a name is most likely to mean."""
    plain = name.removesuffix("_mon")
    return plain if plain in spec.names else next(iter(near(name, spec.names)), None)


def _external(spec: Spec) -> Iterator[SpecProblem]:
    for i, prop in enumerate(spec.properties):
        if prop.external is None:
            continue
        received = prop.external.streams
        for name in sorted(received or ()):
            if name not in spec.names:
                yield SpecProblem(
                    ("properties", i, "streams"), f"the oracle is told of '{name}', {_no_stream(name, spec)}"
                )
        for name in sorted(prop.guards & spec.names):
            if received is not None and name not in received:
                message = f"'{prop.id}' guards {name}, which its oracle does not receive; name it under `streams`"
                yield SpecProblem(("properties", i, "streams"), message)
        for j in sorted(spec.filtered.values()):
            stream = spec.streams[j]
            ordered = stream.ordered and spec.ordering.by != "arrival"
            waits = prop.external.timeout + ((spec.ordering.max_delay or 0) if ordered else 0)
            if stream.decide_within <= waits:
                message = (
                    f"decide_within of {stream.name} is {span(stream.decide_within)}, and must exceed "
                    f"{'max_delay and ' if ordered else ''}the timeout of '{prop.id}', {span(waits)}"
                    f"{' together' if ordered else ''}, since every decision after an event that its oracle receives "
                    f"waits for the oracle; write `decide_within: {span(waits + 10**9)}`"
                )
                yield SpecProblem(("streams", j, "decide_within"), message)


def _causes(spec: Spec) -> Iterator[SpecProblem]:
    for i, stream in enumerate(spec.streams):
        for name in stream.causes:
            if name not in spec.names and stream.leads:
                message = f"{stream.name} causes '{name}', {_no_stream(name, spec)}"
                yield SpecProblem(("streams", i, "causes"), message)


def _undoing(spec: Spec) -> Iterator[SpecProblem]:
    for i, stream in enumerate(spec.streams):
        if stream.on_deny != "undo" or not stream.leads:
            continue
        path = ("streams", i, "on_deny")
        if stream.intercept == "subscriber":
            yield SpecProblem(
                path, "`undo` is for what no one has seen: requests, and topics with `intercept: publisher`"
            )
        if spec.ordering.by == "both":
            yield SpecProblem(path, UNDO_BY_BOTH)
        if stream.on_unavailable == "pass":
            yield SpecProblem(path, "`undo` needs `on_unavailable: deny`: what passed without a decision did happen")
