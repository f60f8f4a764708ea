"""Which topics of a bag are an action's, and of which side of a monitor: hidden ones on ROS 2, plain ones on ROS 1."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from oracle_server.core.kinds import ACTION, Kind
from oracle_server.core.spec import Spec, StreamSpec
from oracle_server.replay.bags.roles import PROXY, Port, Role, Roles, only_passed
from oracle_server.replay.recording import Note

_ROS2 = {
    "send_goal": Port("_action/send_goal/_service_event", ("goal", "reply"), "action/{}_SendGoal"),
    "get_result": Port("_action/get_result/_service_event", ("result",), "action/{}_GetResult"),
    "cancel": Port("_action/cancel_goal/_service_event", ("cancel",), "action_msgs/srv/CancelGoal"),
    "feedback": Port("_action/feedback", ("feedback",), "msg/{}_FeedbackMessage"),
    "status": Port("_action/status", ("status",), "action_msgs/msg/GoalStatusArray"),
}
_ROS1 = {
    "goal": Port("goal", ("goal",), "msg/{}ActionGoal"),
    "cancel": Port("cancel", ("cancel",), "actionlib_msgs/msg/GoalID"),
    "feedback": Port("feedback", ("feedback",), "msg/{}ActionFeedback"),
    "result": Port("result", ("result", "reply"), "msg/{}ActionResult"),
    "status": Port("status", ("status", "reply"), "actionlib_msgs/msg/GoalStatusArray"),
}
_BY_CLIENTS: frozenset[Kind] = frozenset({"goal", "cancel"})
"""What clients send: of that the monitor's side has all, and the server's what passed."""


def add_actions(found: Roles, topics: Mapping[str, int], spec: Spec) -> None:
    """Add the roles of the topics that are beneath a spec's actions; the number of messages of each is given."""
    names = {topic.strip("/"): topic for topic in topics}
    actions: dict[str, list[StreamSpec]] = {}
    for stream in spec.streams:
        if stream.traits.group == ACTION:
            actions.setdefault(stream.name, []).append(stream)
    for streams in actions.values():
        roles, notes = _roles(streams, names, topics)
        for topic, role in roles.items():
            found.by_topic.setdefault(topic, role)
        found.notes.extend(notes)


def _roles(
    streams: Sequence[StreamSpec], names: Mapping[str, str], topics: Mapping[str, int]
) -> tuple[dict[str, Role], list[Note]]:
    """The roles of one action's topics, and what is to be said of them.

    `names` has the topics that there are by their names without slashes around, `topics` how many messages they have.
    """
    first = streams[0]
    filtered = any(stream.action == "filter" for stream in streams)
    kinds = {stream.kind: stream for stream in streams}
    found: dict[str, Role] = {}
    notes: list[Note] = []
    real, beside = first.name.strip("/"), (first.proxy or first.name + PROXY).strip("/")
    of_ros2 = any(f"{side}/{port.topic}" in names for side in (real, beside) for port in _ROS2.values())
    for port in (_ROS2 if of_ros2 else _ROS1).values():
        at_server, at_clients = (names.get(f"{side}/{port.topic}") for side in (real, beside))
        for kind in port.kinds:
            sides = [at_server, at_clients]
            if filtered and kind in _BY_CLIENTS:
                sides.reverse()
            topic = next((t for t in sides if t is not None and topics[t]), None) or next(filter(None, sides), None)
            if topic is None or kind not in kinds:
                continue
            asked = kinds[kind].action == "filter" and topic == sides[0]
            if kinds[kind].action == "filter" and not asked:
                notes.append(only_passed(str(kinds[kind].key), f"no {sides_name(kind, first)}/{port.topic}"))
            known = found.get(topic, Role((), port=port, type=_type(first.type, port), action=first.name))
            asks = (*known.asked, kind) if asked else known.asked
            found[topic] = known._replace(streams=(*known.streams, kinds[kind].key), asked=asks)
        if filtered and "goal" in port.kinds and at_server is not None and at_clients is not None:
            known = found.get(at_server, Role((), port=port, type=_type(first.type, port), action=first.name))
            found[at_server] = known._replace(passes=True)
    return found, notes


def sides_name(kind: Kind, stream: StreamSpec) -> str:
    """The name of the side of an action on which everything of a kind is."""
    return (stream.proxy or stream.name + PROXY) if kind in _BY_CLIENTS else stream.name


def _type(action: str, port: Port) -> str:
    """The type of a port's messages by the action's, empty where that is not given."""
    if "{}" not in port.type:
        return port.type
    package, _, name = action.partition("/action/")
    return f"{package}/{port.type.format(name)}" if name else ""
