"""What `check` warns of in actions: what can keep a robot from being stopped, and what makes decisions slow."""

from __future__ import annotations

from collections.abc import Iterator

from oracle_server.core.errors import SpecProblem
from oracle_server.core.kinds import ACTION
from oracle_server.core.spec import Spec
from oracle_server.core.units import span


def action_hazards(spec: Spec) -> Iterator[SpecProblem]:
    """Whatever the version of ROS."""
    for i, stream in enumerate(spec.streams):
        if stream.traits.group != ACTION:
            continue
        name = stream.name
        if stream.kind == "cancel" and stream.action == "filter":
            yield _warning(
                ("streams", i, "ask"),
                f"`cancel` is asked: a cancel of {name} that a property denies does not stop the robot; leave it out "
                "unless that is meant",
            )
        if stream.kind == "feedback" and stream.proxied and stream.ordered and stream.stamp and _delays(spec):
            yield _warning(
                ("streams", i, "stamp"),
                f"the feedback of {name} is ordered by `{stream.stamp.field}`, so that each decision waits for what of "
                f"it may still be under way, {span(stream.latency)} and more; leave `stamp` out, to have it ordered as "
                "it comes to the proxy, or write `ordered: false`, or `latency: 0s`",
            )
        if stream.kind == "status" and stream.proxied:
            yield _warning(
                ("streams", i, "status"),
                f"the status of {name} is read: at each change of one goal it has all whose results are kept, and "
                "takes its time; `reply` and `result` tell most of it",
            )


def reply_hazards(spec: Spec) -> Iterator[SpecProblem]:
    """On ROS 1, where a reply is the first status of a goal that decides it."""
    for i, stream in enumerate(spec.streams):
        if stream.kind == "reply" and stream.action == "filter":
            yield _warning(
                ("streams", i, "ask"),
                f"`reply` is asked: ROS 1 has no replies to goals, so that {stream.name} is under way once its status "
                "says that it was accepted; ask `goal`",
            )


def _delays(spec: Spec) -> bool:
    """Whether decisions wait for what is ordered."""
    return spec.ordering.by != "arrival" and any(s.action == "filter" and s.ordered for s in spec.streams)


def _warning(path: tuple[str | int, ...], message: str) -> SpecProblem:
    return SpecProblem(path, message, severity="warning")
