"""The types of a spec's streams: what is known of their messages, and what is wrong with their names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from oracle_server.core.errors import SpecProblem
from oracle_server.core.hazards.ros import Ros
from oracle_server.core.kinds import ACTION
from oracle_server.core.shapes import Record, Value
from oracle_server.core.spec import Spec, StreamSpec
from oracle_server.core.typed import Missing, StreamTypes, TypedMessage
from oracle_server.rostypes.known import Types, unknown_within

_PARTS = {
    "request": "_Request", "response": "_Response", "goal": "_Goal", "result": "_Result", "feedback": "_Feedback"
}  # fmt: skip
_TIME = Record("builtin_interfaces/msg/Time", {"sec": Value("whole", "int32"), "nanosec": Value("whole", "uint32")})
_REPLY = Record("the reply to a goal", {"accepted": Value("bool", "bool"), "stamp": _TIME})
_STATUS = Record("the status of a goal", {})
_CANCEL: Mapping[Ros, str] = {1: "actionlib_msgs/msg/GoalID", 2: "action_msgs/msg/GoalInfo"}


def stream_types(spec: Spec, types: Types, ros: Ros | None) -> tuple[StreamTypes, list[SpecProblem]]:
    """The messages of the streams whose types are known, and what is to be said of the others, once a package."""
    found, problems = {}, []
    told: set[str] = set()
    for i, stream in enumerate(spec.streams):
        if not stream.type:
            continue
        message = _message(stream, types, ros)
        if not isinstance(message, Missing):
            found[stream.key] = message
            within = [name for name in message.unknown if name not in told]
            problems += [SpecProblem(("streams", i, "type"), unknown_within(n), severity="warning") for n in within]
            told |= {*within}
        missing = _whole(stream, types, ros) if stream.leads else None
        if isinstance(missing, Missing) and missing.package not in told:
            told |= {missing.package} - {""}
            text = missing.message + (_stamp(stream) if missing.severity == "warning" else "")
            problems.append(SpecProblem(("streams", i, "type"), text, severity=missing.severity))
    return found, problems


def _whole(stream: StreamSpec, types: Types, ros: Ros | None) -> TypedMessage | Missing:
    """A message of the stream's interface that has its type, by which is seen whether that is known."""
    return _message(stream if stream.traits.group != ACTION else replace(stream, kind="goal"), types, ros)


def _message(stream: StreamSpec, types: Types, ros: Ros | None) -> TypedMessage | Missing:
    """The messages of a stream whose type is given; those of some kinds are the same for all actions."""
    if stream.kind == "reply":
        return TypedMessage(_REPLY)
    if stream.kind == "status":
        return TypedMessage(_STATUS)
    if stream.kind != "cancel":
        return types.message(stream.type + _PARTS.get(stream.kind, ""), ros)
    found = types.message(_CANCEL[ros or 2], ros)
    other = types.message(_CANCEL[1], 1) if ros is None else found
    if isinstance(found, Missing) or isinstance(other, Missing):
        return found
    return replace(found, anywhere=replace(found.shape, fields={**other.shape.fields, **found.shape.fields}))


def _stamp(stream: StreamSpec) -> str:
    """What to know of the stamp of a type that is not known."""
    field = stream.stamp.field if stream.stamp and stream.stamp.unit is None else ""
    if not field or field.rpartition(".")[2] == "stamp":
        return ""
    unit = f"as in `stamp: {{field: {field}, unit: us}}`"
    return f". If its `{field}` is a number, it is read as seconds: another unit stands under `stamp`, {unit}"
