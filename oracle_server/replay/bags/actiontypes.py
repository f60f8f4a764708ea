"""The types of what an action sends on its hidden topics, made of its definition."""

from __future__ import annotations

import re
from collections.abc import Sequence

from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore

from oracle_server.replay.bags.definitions import RULE, TypesByName, event_type, lines_of, never_empty
from oracle_server.replay.files.storage import Channel
from oracle_server.rostypes.bagtypes import PARTS

_SENT = re.compile(r"(\w+)/action/(\w+)_(FeedbackMessage|SendGoal_Event|GetResult_Event)")
_ID = "unique_identifier_msgs/UUID goal_id\n"
_TIME = "builtin_interfaces/Time stamp\n"
_STANDARD = {
    "action_msgs/srv/CancelGoal_Event": {
        "action_msgs/msg/CancelGoal_Request": "action_msgs/GoalInfo goal_info\n",
        "action_msgs/msg/CancelGoal_Response": "int8 return_code\naction_msgs/GoalInfo[] goals_canceling\n",
    },
    "action_msgs/msg/GoalStatusArray": {},
}
"""The types that all actions have in common: recorders write the action's own definition beside them."""


def action_types(channel: Channel, known: Typestore) -> TypesByName | None:
    """The types of a channel of an action, None where they are those that the channel defines.

    `known` has the parts of actions whose definitions are on hand, as `pkg/msg/Name_Goal`.
    """
    standard = _STANDARD.get(channel.type)
    if standard is not None:
        found = {name: _type(text, name) for name, text in standard.items()}
        if standard:
            return found | event_type(channel.type)
        return {channel.type: known.fielddefs[channel.type]} if channel.type in known.fielddefs else None
    match = _SENT.fullmatch(channel.type)
    if match is None:
        return None
    package, name, sent = match[1], match[2], match[3]
    prefix = f"{package}/msg/{name}"
    parts = _defined(channel, prefix) or {p: known.fielddefs[p] for p in _parts(prefix) if p in known.fielddefs}
    if not parts:
        return None
    own = f"{package}/{name}"
    texts = {
        "FeedbackMessage": {f"{prefix}_FeedbackMessage": f"{_ID}{own}_Feedback feedback\n"},
        "SendGoal_Event": {
            f"{prefix}_SendGoal_Request": f"{_ID}{own}_Goal goal\n",
            f"{prefix}_SendGoal_Response": f"bool accepted\n{_TIME}",
        },
        "GetResult_Event": {
            f"{prefix}_GetResult_Request": _ID,
            f"{prefix}_GetResult_Response": f"int8 status\n{own}_Result result\n",
        },
    }[sent]
    made = {name: _type(text, name) for name, text in texts.items()}
    return parts | made | (event_type(channel.type) if sent.endswith("_Event") else {})


def _parts(prefix: str) -> list[str]:
    return [f"{prefix}_{part}" for part in PARTS]


def _defined(channel: Channel, prefix: str) -> TypesByName:
    """The goal, result and feedback of an action by its own text, which recorders write; none where that is not it."""
    head, *others = lines_of(channel).split(RULE)
    texts = re.split(r"^---[^\S\n]*$\n?", head, flags=re.MULTILINE)
    if channel.encoding == "ros2idl" or len(texts) != len(PARTS):
        return {}
    try:
        return _read(texts, others, prefix)
    except Exception:  # noqa: BLE001 -- the parser raises anything for a malformed definition
        return {}


def _read(texts: Sequence[str], others: Sequence[str], prefix: str) -> TypesByName:
    found: TypesByName = {}
    for name, text in zip(_parts(prefix), texts, strict=True):
        found |= get_types_from_msg(RULE.join((f"{text}\n", *others)), name)
        found[name] = never_empty(found[name])
    return found


def _type(text: str, name: str) -> object:
    return get_types_from_msg(text, name)[name]
