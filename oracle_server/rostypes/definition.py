"""Reads definitions of messages, services and actions as ROS writes them: the fields of each part, by name."""

from __future__ import annotations

import re
from collections.abc import Mapping

from oracle_server.core.errors import OracleError

Fields = Mapping[str, str]
"""The fields of a message: their types by their names, as `float64[36]` or `geometry_msgs/msg/Point[]`."""

PRIMITIVES = frozenset({
    "bool", "byte", "char", "float32", "float64", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64",
    "uint64", "string", "wstring",
})  # fmt: skip
_TIMES = {"time": "builtin_interfaces/msg/Time", "duration": "builtin_interfaces/msg/Duration"}
_LINE = re.compile(
    r"(?P<type>[A-Za-z]\w*(?:/\w+){0,2})(?:<=\d+)?(?P<list>\[(?:<=)?(?P<size>\d*)\])?"
    r"\s+(?P<name>[A-Za-z]\w*)\s*(?P<rest>.*)"
)
_BOUNDED = re.compile(r"\[<=\d+\]")
_PARTS = {"msg": 1, "srv": 2, "action": 3}
_ACTION = ("Goal", "Result", "Feedback")
_OF_ACTION = {
    "{0}ActionGoal": {"header": "std_msgs/msg/Header", "goal_id": "actionlib_msgs/msg/GoalID", "goal": "{1}Goal"},
    "{0}ActionResult": {
        "header": "std_msgs/msg/Header", "status": "actionlib_msgs/msg/GoalStatus", "result": "{1}Result"
    },
    "{0}ActionFeedback": {
        "header": "std_msgs/msg/Header", "status": "actionlib_msgs/msg/GoalStatus", "feedback": "{1}Feedback"
    },
}  # fmt: skip
"""The messages that ROS 1 makes of an action's parts."""


class DefinitionError(OracleError):
    """A definition that can't be read; `line` counts from 1."""

    def __init__(self, message: str, line: int) -> None:
        super().__init__(message)
        self.line = line


def read_definition(text: str, package: str, kind: str, name: str) -> dict[str, Fields]:
    """The messages that a file of a package defines, by their full names; `kind` is `msg`, `srv` or `action`.

    Of a service these are its request and response, `pkg/srv/Name_Request` and `pkg/srv/Name_Response`; of an action
    `pkg/action/Name_Goal`, `…_Result` and `…_Feedback`, and the messages of ROS 1. Raises `DefinitionError`.
    """
    parts: list[dict[str, str]] = [{}]
    for number, line in enumerate(text.splitlines(), 1):
        stripped = line.strip()
        if stripped == "---":
            parts.append({})
            if len(parts) > _PARTS[kind]:
                raise DefinitionError(f"a .{kind} file has {_PARTS[kind] - 1 or 'no'} lines `---`", number)
        elif stripped and not stripped.startswith(("#", "@")):
            _add_field(parts[-1], stripped, package, number)
    if len(parts) < _PARTS[kind]:
        raise DefinitionError(
            f"a .{kind} file has {_PARTS[kind]} parts, with `---` between them", number if text else 1
        )
    if kind == "msg":
        return {f"{package}/msg/{name}": parts[0]}
    if kind == "srv":
        return {f"{package}/srv/{name}_{half}": part for half, part in zip(("Request", "Response"), parts, strict=True)}
    named = {f"{package}/action/{name}_{part}": fields for part, fields in zip(_ACTION, parts, strict=True)}
    return named | _of_action(f"{package}/msg/{name}", name, parts)


def _add_field(fields: dict[str, str], line: str, package: str, number: int) -> None:
    match = _LINE.fullmatch(line)
    if match is None:
        text = line if len(line) <= 60 else line[:60] + "…"
        raise DefinitionError(f"`{text}` is no field; write a type and a name, as in `float64 speed`", number)
    if match["rest"].startswith("=") and match["type"] in PRIMITIVES and not match["list"]:
        return  # a constant, which is no field of a message
    if match["name"] in fields:
        raise DefinitionError(f"the field `{match['name']}` stands here a second time", number)
    suffix = f"[{match['size']}]" if match["list"] else ""
    if suffix and _BOUNDED.fullmatch(match["list"]):
        suffix = "[]"
    fields[match["name"]] = _full(match["type"], package, number) + suffix


def _full(name: str, package: str, number: int) -> str:
    if name in PRIMITIVES:
        return name
    if name in _TIMES:
        return _TIMES[name]
    if name == "Header":
        return "std_msgs/msg/Header"
    match name.split("/"):
        case [own]:
            if own[0].islower():
                raise DefinitionError(
                    f"`{own}` is no type; those of one value are {', '.join(sorted(PRIMITIVES))}", number
                )
            return f"{package}/msg/{own}"
        case [other, short]:
            return f"{other}/msg/{short}"
        case _:
            return name


def _of_action(prefix: str, short: str, parts: list[dict[str, str]]) -> dict[str, Fields]:
    made: dict[str, Fields] = {f"{prefix}{part}": fields for part, fields in zip(_ACTION, parts, strict=True)}
    package = prefix.rpartition("/")[0]
    for name, fields in _OF_ACTION.items():
        made[f"{package}/{name.format(short)}"] = {key: type_.format(short, prefix) for key, type_ in fields.items()}
    made[f"{prefix}Action"] = {f"action_{p}": f"{prefix}Action{p.title()}" for p in ("goal", "result", "feedback")}
    return made
