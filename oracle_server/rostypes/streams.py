"""The types of a spec's streams: what is known of their messages, and what is wrong with their names."""

from __future__ import annotations

from oracle_server.core.errors import SpecProblem
from oracle_server.core.ros import Ros
from oracle_server.core.spec import Spec, StreamSpec
from oracle_server.core.typed import Missing, StreamTypes
from oracle_server.rostypes.known import Types

_HALVES = {"request": "_Request", "response": "_Response"}


def stream_types(spec: Spec, types: Types, ros: Ros | None) -> tuple[StreamTypes, list[SpecProblem]]:
    """The messages of the streams whose types are known, and what is to be said of the others, once a package."""
    found, problems = {}, []
    told: set[str] = set()
    for i, stream in enumerate(spec.streams):
        if not stream.type:
            continue
        message = types.message(stream.type + _HALVES.get(stream.kind, ""), ros)
        if not isinstance(message, Missing):
            found[stream.key] = message
        elif stream.traits.leads and message.package not in told:
            told |= {message.package} - {""}
            text = message.message + (_stamp(stream) if message.severity == "warning" else "")
            problems.append(SpecProblem(("streams", i, "type"), text, severity=message.severity))
    return found, problems


def _stamp(stream: StreamSpec) -> str:
    """What to know of the stamp of a type that is not known."""
    field = stream.stamp.field if stream.stamp and stream.stamp.unit is None else ""
    if not field or field.rpartition(".")[2] == "stamp":
        return ""
    unit = f"as in `stamp: {{field: {field}, unit: us}}`"
    return f". If its `{field}` is a number, it is read as seconds: another unit stands under `stamp`, {unit}"
