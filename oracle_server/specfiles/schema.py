"""The JSON Schema of spec files, by which editors complete, describe and check them as they are written.

What a schema can't say, as what formulas mean, `check` says.
"""

from __future__ import annotations

from typing import Any

from oracle_server.core.units import span
from oracle_server.specfiles.model import SpecModel

_DRAFT = "https://json-schema.org/draft/2020-12/schema"
_OWN_NUMBERS = {"gt", "ge", "le", "lt"}
"""What pydantic leaves of a bound on nanoseconds, which are texts in the file."""
DESCRIPTIONS = {
    "SpecModel.id": "The spec's name, by which sessions and adapters ask for it",
    "SpecModel.description": "What people are told of it",
    "SpecModel.ordering": "How events get into the order in which they are judged",
    "SpecModel.retention": "How long, and how much of, the history of its sessions is kept",
    "SpecModel.episodes": "Which violations are told as one",
    "SpecModel.close": "When a session without a monitor is closed, as `after 1h`",
    "SpecModel.streams": "What is observed: topics, services and actions",
    "SpecModel.define": "Names for formulas, as `moving: '{speed > 0.1}'`; with variables as `at(r)`",
    "SpecModel.derive": "Signals of other signals: an expression over them, or one operation over a window",
    "SpecModel.properties": "What must hold",
    "OrderingModel.by": "The order that is judged: of publication (default), of arrival, or both side by side",
    "OrderingModel.max_delay": "Longest wait for older events (200ms); `none` waits for every stream",
    "OrderingModel.late": "What becomes of an event older than one already judged: it is judged where it comes "
    "(default), skipped, or put in its place (`revise`)",
    "OrderingModel.horizon": "With `late: revise`, how much older than the newest event one may be (2s, at most 1h)",
    "OrderingModel.max_skew": "A stamp further ahead of its arrival than this (1s) is ordered at its arrival",
    "OrderingModel.capacity": "Events that are held; beyond, the oldest is judged, and verdicts are degraded",
    "StampModel.field": "The field of the publication time, as `header.stamp`",
    "StampModel.unit": "What its numbers count; a time such as `header.stamp` has none",
    "StampModel.epoch": "Since when it counts: 1970 (`unix`, default) or the start of the robot (`boot`)",
    "hold": "Signals that keep their value until the next message",
    "each": "A list of the message, as `msg.transforms`: each element is a step of its own, `item` in signals",
    "signals": "What formulas see: names, each with an expression over the message `msg`",
    "stamp": "The field of the publication time, as `header.stamp`",
    "TopicModel.topic": "The topic's name, as `/scan`",
    "TopicModel.type": "The message's type, as `sensor_msgs/msg/LaserScan`; an adapter needs it",
    "TopicModel.intercept": "Of a filtered topic `/x`: `publisher` observes `/x_mon` and forwards to `/x` (default), "
    "`subscriber` observes `/x` and forwards to `/x_mon`",
    "ServiceModel.service": "The service's name, as `/SetLED`",
    "ServiceModel.type": "Its type, as `std_srvs/srv/SetBool`; an adapter needs it",
    "ServiceModel.denied_response": "On ROS 2, the fields of the response to a denied call",
    "ServiceModel.request": "Signals of its requests, and when they were published",
    "ServiceModel.response": "Signals of its responses, and when they were published",
    "proxy": "The name that clients use; the interface's own with `_mon` by default",
    "ActionModel.ros_action": "The action's name, as `/navigate_to_pose`",
    "ActionModel.type": "Its type, as `nav2_msgs/action/NavigateToPose`; an adapter needs it",
    "ActionModel.via": "`introspection`: nothing is proxied, and what the server's node tells of it is observed",
    "ActionModel.ask": "With `action: filter`, the kinds of its events that are decided; goals by default",
    "ActionModel.denied_result": "Fields of the result in place of one that is denied",
    "ActionModel.goal": "Goals that clients send",
    "ActionModel.reply": "That the server accepts or rejects a goal",
    "ActionModel.feedback": "Feedback",
    "ActionModel.cancel": "Cancels that clients send",
    "ActionModel.result": "Results that clients get",
    "ActionModel.status": "Changes of goals' status",
    "latency": "Longest time that a message usually takes from its stamp to the adapter (20ms)",
    "ordered": "`false`: judged as it arrives, at the session's present, making nothing late",
    "causes": "Streams that can't speak until this one's message has passed, for `check` to find deadlocks",
    "action": "`filter`: what is denied does not pass; `log` (default): it is only observed",
    "on_unavailable": "What becomes of a message while the oracle is away: it is denied (default), or passes",
    "decide_within": "Longest wait for a decision (2s)",
    "on_deny": "Whether later verdicts see a denied event: `keep` (default) or `undo`",
    "PropertyModel.id": "Its name",
    "PropertyModel.description": "What people are told of it",
    "PropertyModel.formula": "What must hold, as `{topic: /cmd_vel} -> not {stopped}`",
    "PropertyModel.pattern": "In place of a formula, a pattern, as `after /start: {goal} causes /status within 60s`",
    "PropertyModel.requirement": "In place of a formula, a sentence in FRETish over names of `define`, as "
    "`In auto, when low the robot shall within 30 seconds satisfy docking`",
    "PropertyModel.machine": "In place of a formula, the name of a machine, which must be in no error",
    "PropertyModel.time": "What bounds count: `steps` (default) or `seconds`",
    "PropertyModel.guards": "The filtered streams whose events it may deny",
    "PropertyModel.blame": "Which events it denies: `any` at which it is negative (default), or those that `caused` it",
    "PropertyModel.latch": "Once negative, it stays so",
    "PropertyModel.at_end": "What is still awaited when the session ends: `ignore` (default) or `violated`",
    "PropertyModel.engine": "Who judges it; `auto` (default) is the project's own",
    "PropertyModel.url": "Of an oracle elsewhere: its WebSocket, as `ws://127.0.0.1:8080`",
    "PropertyModel.timeout": "Of an oracle elsewhere: longest wait for an answer (1s); more is `unknown`",
    "PropertyModel.streams": "Of an oracle elsewhere: whose events it is told; all by default",
    "PropertyModel.names": "Of an oracle elsewhere: it is told `/a` (`full`, default) or `a` (`bare`)",
    "RetentionModel.age": "How long a session is kept after it was closed, as `168h`; of an open one, its events",
    "RetentionModel.events": "How many events all sessions of the spec have together",
    "RetentionModel.size": "How many bytes they take together, as `500MB`",
    "EpisodesModel.gap": "Violations of a property less than this apart are one episode (1s)",
    "DeriveModel.expression": "An expression over signals, as `limit - speed`",
    "DeriveModel.count": "How many steps in the window a formula held at",
    "DeriveModel.rate": "The same a second",
    "DeriveModel.sum": "The exact sum of a signal's samples in the window",
    "DeriveModel.mean": "Their mean",
    "DeriveModel.min": "The least of them",
    "DeriveModel.max": "The greatest of them",
    "DeriveModel.last": "The last sample of a signal, whoever sent it",
    "DeriveModel.previous": "The sample before the last one",
    "DeriveModel.delta": "The last sample minus the one before it",
    "DeriveModel.age": "Seconds since a formula held",
    "DeriveModel.over": "The window: a time, as `2s`, or a number of samples, as `20`",
    "DeriveModel.by": "One for each value of this signal; a machine also for each of several",
    "DeriveModel.follows": "A machine: the signal whose values are its states",
    "DeriveModel.states": "A machine: its states, each with those that may follow, or with events and where they lead",
    "DeriveModel.start": "A machine: the state in which it begins",
    "DeriveModel.otherwise": "A machine: where other events lead: to `error` (default), `stay`, or a state",
    "DeriveModel.sequence": "A machine: the order of its events, as `open (read | write)* close`",
    "DeriveModel.forget": "With `by`: how long a value is remembered that has not come again",
}
"""Of each key: by its model, or for all models that have a key of that name."""


def spec_schema() -> dict[str, Any]:
    """The schema, as plain data."""
    schema = SpecModel.model_json_schema()
    models = schema.pop("$defs")
    for name, model in [("SpecModel", schema), *models.items()]:
        del model["title"]
        for key, value in model["properties"].items():
            model["properties"][key] = _key(value) | {"description": description(name, key)}
    schema["description"] = "A spec: what is observed of a robot, and what must hold"
    return {"$schema": _DRAFT, "title": "oracle-server spec", **schema, "$defs": models}


def description(model: str, key: str) -> str:
    """What a key of a model means."""
    return DESCRIPTIONS.get(f"{model}.{key}") or DESCRIPTIONS[key]


def _key(value: dict[str, Any]) -> dict[str, Any]:
    """A key's schema, as people write the key."""
    kept = {k: v for k, v in value.items() if k not in ("title", *_OWN_NUMBERS)}
    if "anyOf" in kept:
        kept["anyOf"] = [_key(each) for each in kept["anyOf"]]
    default = kept.get("default")
    if isinstance(default, int) and not isinstance(default, bool) and kept.get("type") != "integer":
        kept["default"] = span(default)
    elif default in (None, "", [], {}) or isinstance(default, dict):
        kept.pop("default", None)
    return kept
