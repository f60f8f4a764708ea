"""What `check` finds by the types of messages: fields that are read and are not there, and values that do not fit."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from oracle_server.core.errors import ExpressionError, SpecProblem
from oracle_server.core.expression import Expression, Problem, check_rows, check_shape, no_field, parse_expression
from oracle_server.core.formula.render import render_atom
from oracle_server.core.formula.tree import Atom
from oracle_server.core.hazards.percents import percents
from oracle_server.core.hazards.readings import at, lacking
from oracle_server.core.kinds import RESERVED
from oracle_server.core.nearest import either, listed, nearest
from oracle_server.core.plan import can_meet, has_reserved, not_signals, reserved_of
from oracle_server.core.shapes import Many, Record, Shape, Unknown, Value, fits
from oracle_server.core.spec import Spec, StreamSpec
from oracle_server.core.stamps import Stamp
from oracle_server.core.typed import StreamTypes, TypedMessage

_Check = Callable[[Expression, Shape | None], list[Problem]]
_TIME_FIELDS = ("sec", "nanosec")


def inspect_fields(spec: Spec, types: StreamTypes) -> list[SpecProblem]:
    """Everything that is wrong or doubtful in a spec about the fields of its messages."""
    return [
        *_expressions(spec, types),
        *_stamps(spec, types),
        *_responses(spec, types),
        *_default_signals(spec, types),
        *percents(spec, types),
    ]


def _expressions(spec: Spec, types: StreamTypes) -> Iterator[SpecProblem]:
    for i, stream in enumerate(spec.streams):
        known = types.get(stream.key)
        if known is None:
            continue
        read: list[tuple[tuple[str, ...], str, Callable[[], Expression], _Check]] = [
            (("signals", name), f"signal '{name}'", partial(stream.read, text), check_shape)
            for name, text in (stream.signals or {}).items()
        ]
        if stream.each is not None:
            read.append((("each",), "`each`", partial(parse_expression, stream.each), check_rows))
        for path, what, parse, check in read:
            try:
                expression = parse()
            except ExpressionError:
                continue  # found by `inspect`
            told = {problem.within for problem in check(expression, None)}  # by `inspect`
            for problem in _of_all(known, partial(check, expression)):
                if problem.severity == "error" or problem.within not in told:
                    message = f"{what}: {problem.message}"
                    yield SpecProblem(("streams", i, *path), message, problem.within, problem.severity)


def _of_all(known: TypedMessage, check: Callable[[Shape], list[Problem]]) -> Iterator[Problem]:
    """The problems with the newest definition; warnings where another distribution's has none there."""
    problems = check(known.shape)
    if not problems or known.anywhere is None:
        yield from problems
        return
    everywhere = {problem.within for problem in check(known.anywhere)}
    for problem in problems:
        if problem.severity == "warning" or problem.within in everywhere:
            yield problem
        else:
            yield Problem(f"{problem.message} (another version of ROS has it)", problem.within, "warning")


def _stamps(spec: Spec, types: StreamTypes) -> Iterator[SpecProblem]:
    for i, stream in enumerate(spec.streams):
        known = types.get(stream.key)
        if stream.stamp is None or known is None:
            continue
        field = stream.stamp.field
        reason = _no_time(known.widest, stream.stamp)
        if reason:
            yield SpecProblem(("streams", i, "stamp"), f"stamp of {stream.key}: {reason}")
            continue
        path = tuple(field.split("."))
        found, around = at(known.widest, path), at(known.widest, path[:-1])
        if isinstance(found, Value) and isinstance(around, Record) and around.name.startswith("geometry_msgs/"):
            why = f"`{field}` is a number of a {around.name}, which is no time"
            message = f"stamp of {stream.key}: {why}; name a field that is one, or leave `stamp` out"
            yield SpecProblem(("streams", i, "stamp"), message, severity="warning")
        elif isinstance(found, Value) and found.kind == "whole" and stream.stamp.unit is None:
            message = (
                f"{found.type} `{field}` is read as seconds; say its unit, as in `stamp: {{field: {field}, unit: us}}`"
            )
            yield SpecProblem(("streams", i, "stamp"), message, severity="warning")


def _no_time(shape: Record, stamp: Stamp) -> str:
    """Why a field of a message can't be its publication time, empty where it can."""
    field = stamp.field
    path = tuple(field.split("."))
    if path[0] == "msg" and "msg" not in shape.fields and len(path) > 1:
        return f"a stamp names a field alone; write `{'.'.join(path[1:])}`, without `msg.`"
    reason = lacking(shape, path)
    if reason:
        return reason
    found = at(shape, path)
    if isinstance(found, Unknown) or (isinstance(found, Value) and found.kind in ("whole", "real")):
        return ""
    if isinstance(found, Record) and all(_is_whole(found.fields.get(name)) for name in _TIME_FIELDS):
        return f"`{field}` is a time, which has its unit; leave `unit` out" if stamp.unit else ""
    return f"`{field}` is {_described(found)}; name a time, or a number with its unit"


def _is_whole(shape: Shape | None) -> bool:
    return isinstance(shape, Value) and shape.kind == "whole"


def _described(shape: Shape | None) -> str:
    if isinstance(shape, Value):
        return f"of the type {shape.type}"
    return "a list" if isinstance(shape, Many) else f"a {shape.name}" if shape else "not there"


def _responses(spec: Spec, types: StreamTypes) -> Iterator[SpecProblem]:
    """The fields of `denied_response` and `denied_result`, against those of what they stand for."""
    for i, stream in enumerate(spec.streams):
        of_kind = {
            "response": ("denied_response", stream.denied_response),
            "result": ("denied_result", stream.denied_result),
        }
        key, given = of_kind.get(stream.kind, ("", None))
        known = types.get(stream.key)
        if given is not None and known is not None:
            for path, message in _unfit(known.widest, given, ()):
                yield SpecProblem(("streams", i, key, *path), f"{key} of {stream.name}: {message}")


def _unfit(shape: Shape, value: Any, path: tuple[str | int, ...]) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """The parts of a value that do not fit a shape, and why."""
    name = ".".join(str(part) for part in path)
    match shape:
        case Record() if isinstance(value, Mapping):
            for key, inner in value.items():
                if key in shape.fields:
                    yield from _unfit(shape.fields[key], inner, (*path, key))
                else:
                    yield (*path, key), no_field(shape, str(key))
        case Many() if isinstance(value, list):
            if shape.length is not None and len(value) != shape.length:
                yield path, f"`{name}` has {shape.length} items, not {len(value)}"
            for i, inner in enumerate(value):
                yield from _unfit(shape.of, inner, (*path, i))
        case Unknown():
            return
        case Value() if fits(shape, value):
            return
        case _:
            yield path, f"{value!r} does not fit `{name}`, which is {_described(shape)}"


# Signals that no stream declares


def _default_signals(spec: Spec, types: StreamTypes) -> Iterator[SpecProblem]:
    held = spec.kept
    for i, stream in enumerate(spec.streams):
        yield from _held_fields(i, stream, types)
    warned: set[str] = set()
    for i, prop in enumerate(spec.properties):
        for atom in prop.atoms:
            for severity, key, message in _doubts(atom, spec, types, held, warned):
                text = f"formula of '{prop.id}': {message}"
                yield SpecProblem(("properties", i, "formula"), text, atom.at, severity)
                warned.add(key)
    for definition in spec.derive:
        for atom in definition.atoms:
            place = atom.at if definition.formula is not None else None
            for severity, key, message in _doubts(atom, spec, types, held, warned):
                text = f"derived signal '{definition.name}': {message}"
                yield SpecProblem(("derive", definition.name, definition.op), text, place, severity)
                warned.add(key)


def _held_fields(i: int, stream: StreamSpec, types: StreamTypes) -> Iterator[SpecProblem]:
    known = types.get(stream.key)
    if stream.signals is None and known is not None:
        for name in sorted(stream.hold - RESERVED):
            reason = _no_signal(known.widest, name)
            if reason:
                yield SpecProblem(("streams", i, "hold"), f"'{name}' is held: {reason}")


def _doubts(
    atom: Atom, spec: Spec, types: StreamTypes, held: frozenset[str], warned: Collection[str]
) -> Iterator[tuple[Any, str, str]]:
    """What is wrong with the signals that an atom reads of streams without `signals`: how much, which, and why."""
    streams = [s for s in spec.streams if can_meet(s, atom)]
    if all(s.signals is not None for s in streams):
        return  # found by `inspect`
    possible = streams
    for key in dict.fromkeys(c.key for c in atom.constraints if c.key not in RESERVED):
        if all(s.signals is not None or key in not_signals(s) for s in streams) and key not in held:
            return  # found by `inspect`
        having = {s.key: _has(s, key, types, held) for s in streams}
        possible = [s for s in possible if having[s.key] is not False]
        if True in having.values():
            continue
        doubtful = [s for s in streams if having[s.key] is None]
        if doubtful and key in warned:
            continue
        if doubtful:
            meant = _stream_meant(key, atom, spec)
            yield "warning", key, f"{_read_of_unknown(key, doubtful, streams, spec.streams)}{meant}"
        else:
            yield "error", key, _unknown_signal(key, streams, types, held)
            return
    if not possible:
        yield "error", "", f"no event of this spec has all the signals of {render_atom(atom)}"


def _stream_meant(key: str, atom: Atom, spec: Spec) -> str:
    """What to write for a signal that an atom compares with the name of a stream, as `action: /dock`; mostly empty."""
    asked = {c.value for c in atom.constraints if c.key == key}
    named = next((s for s in spec.streams if s.name in asked), None)
    return f'; for the stream write `{named.traits.group}: "{named.name}"`' if named else ""


def _has(stream: StreamSpec, key: str, types: StreamTypes, held: frozenset[str]) -> bool | None:
    """Whether events of a stream can have a signal; None where its type, which is not known, decides it."""
    if key in reserved_of(stream):
        return has_reserved(stream, key)
    if key in held:
        return True
    if stream.signals is not None:
        return key in stream.signals
    if key in not_signals(stream):
        return False
    known = types.get(stream.key)
    return None if known is None else isinstance(known.widest.fields.get(key), Value)


def _no_signal(shape: Record, name: str) -> str:
    """Why a field of a message is no signal without an expression, empty where it is."""
    found = shape.fields.get(name)
    if isinstance(found, Value):
        return ""
    if found is None:
        return no_field(shape, name)
    said = f"the field '{name}' of {shape.name} is {_described(found)}, no single value"
    return f"{said}; write one under `signals`, as `msg.{name}{_to_a_value(found)}`"


def _to_a_value(shape: Shape) -> str:
    """What leads from a field to one value inside of it, for an example."""
    text = ""
    while not isinstance(shape, Value):
        if isinstance(shape, Many):
            text, shape = f"{text}[0]", shape.of
        elif isinstance(shape, Record) and shape.fields:
            name, shape = next(iter(shape.fields.items()))
            text += f".{name}"
        else:
            break
    return text


def _read_of_unknown(
    key: str, doubtful: Sequence[StreamSpec], possible: Iterable[StreamSpec], streams: Iterable[StreamSpec]
) -> str:
    """What is said of a signal that an atom reads of streams whose messages are not known, of all that it may mean."""
    first, where = doubtful[0], either(str(s.key) for s in doubtful)
    why = f"whose type, {first.type}, is not known here" if first.type else "whose `type` is not given"
    read = f"it would be read from a field of {where}, {why}"
    owners = [str(s.key) for s in streams if key in (s.signals or ())]
    if owners:
        return f"'{key}' is a signal of {listed(owners)}, and not declared here: {read}"
    meant = nearest(key, {name for s in possible for name in s.signals or ()})
    return f"'{key}' is declared by no stream; {read}{f'; {meant}' if meant else ''}"


def _unknown_signal(key: str, streams: list[StreamSpec], types: StreamTypes, held: frozenset[str]) -> str:
    plain = [(s, types[s.key].widest) for s in streams if s.signals is None]
    reasons = [_no_signal(shape, key) for _, shape in plain if key in shape.fields]
    if reasons:
        return f"unknown signal '{key}': {reasons[0]}"
    declared = {name for s in streams for name in s.signals or ()} | held
    own = {name for _, shape in plain for name, inner in shape.fields.items() if isinstance(inner, Value)}
    where = either(f"{s.key} ({shape.name})" for s, shape in plain)
    others = f"those of a single value are {listed(sorted(own))}" if own else "it has none of a single value"
    others += f"; declared are {listed(sorted(declared))}" if declared else ""
    return f"unknown signal '{key}'; {where} has no such field; {nearest(key, declared | own) or others}"
