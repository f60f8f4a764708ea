"""The `attached` frame: all that an adapter needs to observe, filter and proxy a session's streams."""

from __future__ import annotations

from oracle_server.core.events import StreamKey
from oracle_server.core.kinds import ACTION
from oracle_server.core.plan import Plan
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.monitor import Monitor
from oracle_server.wire.frames import AttachedFrame, StreamFrame
from oracle_server.wire.incoming import MAX_BATCH, MAX_DEPTH, MAX_FRAME


def attached_frame(session: LiveSession, monitor: Monitor) -> AttachedFrame:
    """The `attached` frame of a monitor."""
    return {
        "type": "attached",
        "monitor": monitor.name,
        "session": session.id,
        "spec": session.spec.id,
        "spec_digest": session.spec.digest,
        "streams": [stream_frame(session.core.plan, key) for key in monitor.streams],
        "next": monitor.numbering.next,
        "first": monitor.first,
        "limits": {
            "max_frame": MAX_FRAME,
            "max_batch": MAX_BATCH,
            "max_outcomes": MAX_BATCH,
            "max_depth": MAX_DEPTH,
            "credit": session.credit.left[monitor.name],
        },
    }


def stream_frame(plan: Plan, key: StreamKey) -> StreamFrame:
    """One stream of the frame: durations in nanoseconds, `fields` the dotted paths that are read, null for all.

    `stamp` is null too where the server reads it itself, since adapters read numbers as seconds since 1970.
    """
    stream, fields = plan.spec.by_key[key], plan.streams[key].fields
    frame: StreamFrame = {
        "name": stream.name,
        "kind": stream.kind,
        "type": stream.type,
        "action": stream.action,
        "ordered": stream.ordered,
        "stamp": stream.stamp.field if stream.stamp and stream.stamp.plain else None,
        "latency": stream.latency,
        "fields": None if fields is None else sorted(fields),
    }
    if plan.streams[key].named:
        frame["reads"] = sorted(plan.streams[key].named)
    if stream.action == "filter":
        frame |= {"on_unavailable": stream.on_unavailable, "decide_within": stream.decide_within}
    if stream.traits.group == ACTION:
        proxy = stream.proxy if stream.proxied else None
        frame |= {"proxy": proxy, "via": stream.via, "denied_result": stream.denied_result}
    elif stream.proxied:
        frame |= {"proxy": stream.proxy, "denied_response": stream.denied_response}
    else:
        frame["intercept"] = stream.intercept
    return frame
