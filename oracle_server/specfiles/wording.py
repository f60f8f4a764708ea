"""What is wrong with the keys and values of a spec, and what to write instead: of each key, what it takes."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from oracle_server.core.errors import Finding
from oracle_server.core.formula.foreign import UNITS
from oracle_server.core.kinds import ACTION, GROUPS, NOUNS, OF_ACTIONS
from oracle_server.core.nearest import near, nearest
from oracle_server.specfiles.document import Document, KeyPath
from oracle_server.specfiles.mending import at, is_map, mend
from oracle_server.specfiles.model import (
    ActionModel,
    DeriveModel,
    EpisodesModel,
    HalfModel,
    OrderingModel,
    PartModel,
    PropertyModel,
    RetentionModel,
    ServiceModel,
    SpecModel,
    StampModel,
    TopicModel,
)

_NAMES = "a list of topics and services, such as [/cmd_vel]"
_DURATION = "a time such as 20ms, 2s or 1.5s"
_DERIVED = "one of count, rate, sum and so on, such as {rate: '{topic: /scan}', over: 2s}, or an expression"
_SWITCH = "true or false, without quotes"
_TAKES: Mapping[str, str] = {
    "id": "1 to 64 letters, digits, `_`, `-` and `.`, as in speed_limit",
    "description": "a text",
    "topic": "a ROS name such as /cmd_vel",
    "service": "a ROS name such as /set_mode",
    ACTION: "a ROS name such as /navigate_to_pose",
    "proxy": "a ROS name such as /set_mode_mon",
    "type": "a type such as std_msgs/msg/Bool, of a service std_srvs/srv/SetBool, of an action pkg/action/Name",
    "stamp": "a field of the message, such as header.stamp",
    "field": "a field of the message, such as header.stamp",
    "signals": "names, each with an expression, such as {speed: msg.data}",
    "each": "an expression for a list, such as msg.transforms",
    "hold": "a list of signals, such as [speed]",
    "causes": _NAMES,
    "guards": _NAMES,
    "request": "keys of its own, such as {signals: {speed: msg.speed}}",
    "response": "keys of its own, such as {signals: {ok: msg.success}}",
    "denied_response": "fields of the response, such as {success: false}",
    "denied_result": "fields of the result, such as {error_code: 9}",
    "ask": "a list of kinds, such as [goal, result]",
    **dict.fromkeys(OF_ACTIONS, "keys of its own, such as {signals: {x: msg.x}}, or {}"),
    "ordered": _SWITCH,
    "latch": _SWITCH,
    "latency": _DURATION,
    "decide_within": _DURATION,
    "max_skew": _DURATION,
    "horizon": f"{_DURATION}, longer than 0s and at most an hour",
    "timeout": f"{_DURATION}, longer than 0s",
    "age": _DURATION,
    "max_delay": f"{_DURATION}, or none",
    "size": "a size such as 500MB or 2GB",
    "capacity": "a whole number from 1 to 1000000",
    "events": "a whole number, at least 1",
    "formula": "a text in quotes, such as '{speed > 1} -> {enabled}'",
    "pattern": "a text in quotes, such as '/goal causes /status within 60s'",
    "requirement": "a text in quotes, such as 'when low the robot shall within 30 seconds satisfy docking'",
    "machine": "the name of a machine under `derive`",
    "define": "names, each with a formula in quotes, such as moving: '{speed > 0.1}'",
    "url": "an address such as ws://127.0.0.1:8080",
    "ordering": "keys of its own, such as {max_delay: 500ms}",
    "retention": "keys of its own, such as {age: 168h}",
    "episodes": "keys of its own, such as {gap: 2s}",
    "gap": _DURATION,
    "close": "a time without a monitor, such as after 1h",
    "properties": "a list of at least one property, each of which begins with `- id:`",
    "derive": "names, each with what it is, such as {scan_rate: {rate: '{topic: /scan}', over: 2s}}",
}
"""What each key takes, those aside that take one of some words."""
_DERIVING: Mapping[str, str] = {
    "expression": "an expression over signals, such as 'limit - speed'",
    **dict.fromkeys(("count", "rate", "age"), "a formula in quotes, such as '{topic: /scan}'"),
    **dict.fromkeys(("sum", "mean", "min", "max", "last", "previous", "delta"), "the name of a signal"),
    "by": "the name of a signal, or for a machine a list of at most four, as [node, goal]",
    "over": "a time such as 2s, or a number of samples such as 20",
    "forget": f"{_DURATION}, longer than 0s",
    "follows": "the name of a signal",
    "states": "states, each with those that may follow, as {IDLE: [AUTO]}, or with its events, as {idle: {go: moving}}",
    "start": "the name of a state",
    "otherwise": "error, stay, or the name of a state",
    "sequence": "events in quotes, such as 'open (read | write)* close'",
}
"""What each key of a derived signal takes."""
_STREAMS = "a list of at least one stream, each of which begins with `- topic:`, `- service:` or `- ros_action:`"
_LEVELS: Mapping[str, Any] = {
    "the file": SpecModel,
    "`ordering`": OrderingModel,
    "`retention`": RetentionModel,
    "`episodes`": EpisodesModel,
    "a topic": TopicModel,
    "a service": ServiceModel,
    "an action": ActionModel,
    "`request` or `response`": HalfModel,
    "a kind of an action": PartModel,
    "`stamp`": StampModel,
    "a property": PropertyModel,
    "a derived signal": DeriveModel,
}
"""The keys that there are, by where they stand."""
PARTS = ("request", "response", *OF_ACTIONS)
"""The keys of streams below which signals may stand."""
_BELOW: Mapping[str, tuple[str, type[HalfModel]]] = {
    "a service": ("`request` or `response`", HalfModel),
    "an action": ("a kind of its events, such as `goal`", PartModel),
}
"""Below which keys signals stand, where they do not stand below the stream itself."""
_INSIDE: Mapping[tuple[str, str], str] = {
    **{("", half): "`request` or `response`" for half in ("request", "response")},
    **{(ACTION, kind): "a kind of an action" for kind in OF_ACTIONS},
    ("", "stamp"): "`stamp`",
}
"""Where the keys stand below a key of a stream, by the stream's group, empty for any."""
_FIRST = ("topic", "service", ACTION, "type", "request", "response", *OF_ACTIONS, "signals", "hold", "stamp")
"""The keys of a stream that are told first."""
_KEYS_MEANT: Mapping[str, Mapping[str, str]] = {
    "the file": {"name": "id", "topics": "streams", "services": "streams", "rules": "properties",
        "formulas": "properties", "requirements": "properties", "derived": "derive", "compute": "derive",
        **dict.fromkeys(("definitions", "macros", "names", "let"), "define")},
    "a topic": {"name": "topic", "msg_type": "type", "message_type": "type", "datatype": "type", "fields": "signals",
        "variables": "signals", "timestamp": "stamp", "keep": "hold", "timeout": "decide_within"},
    "a service": {"name": "service", "srv_type": "type", "timeout": "decide_within", "req": "request",
        "res": "response", "resp": "response", "reply": "response"},
    "an action": {"name": ACTION, "action_type": "type", "timeout": "decide_within", "request": "goal",
        "response": "reply", "accepted": "reply", "get_result": "result", "send_goal": "goal", "cancel_goal": "cancel",
        "guard": "ask", "asks": "ask", "denied_response": "denied_result"},
    "a kind of an action": {"fields": "signals", "variables": "signals", "keep": "hold"},
    "`request` or `response`": {"fields": "signals", "variables": "signals", "keep": "hold"},
    "a property": {"name": "id", **dict.fromkeys(("expression", "expr", "ltl", "stl", "spec", "rule"), "formula"),
        **dict.fromkeys(("hpl", "says"), "pattern"), **dict.fromkeys(("fret", "fretish", "shall"), "requirement"),
        "guard": "guards", "message": "description", "unit": "time", "clock": "time"},
    "a derived signal": {"window": "over", "within": "over", "avg": "mean", "average": "mean", "frequency": "rate",
        "hz": "rate", "key": "by", "group_by": "by", "per": "by", "minimum": "min", "maximum": "max",
        "difference": "delta", "diff": "delta", "total": "sum"},
}  # fmt: skip
"""What people call keys elsewhere, by where they stand."""
_MEANT = {
    "block": "filter", "deny": "filter", "drop": "filter skip", "revert": "undo", "rollback": "undo",
    "guard": "filter", "enforce": "filter", "observe": "log", "monitor": "log", "none": "log",
    "pub": "publisher", "sub": "subscriber", "step": "steps", "events": "steps", "s": "seconds",
    "second": "seconds", "sec": "seconds", "ms": "seconds", "time": "seconds", "allow": "pass",
    "accept": "pass", "block_all": "deny", "drop_late": "skip", "discard": "skip", "stamp": "publication",
    "timestamp": "publication", "published": "publication", "receipt": "arrival", "received": "arrival",
}  # fmt: skip
"""Words that people write for some that there are, each for those that it may mean."""


def model_findings(document: Document, problems: Sequence[Any]) -> list[Finding]:
    """What is to be said of what the models refuse."""
    paths = [_without_tags(problem["loc"]) for problem in problems]
    unknown = {path for path, problem in zip(paths, problems, strict=True) if problem["type"] == "extra_forbidden"}
    actions = {path[:2] for path in paths if path[:1] == ("streams",) and _is_action(at(document.value, path[:2]))}
    explained = {(*path[:-1], key) for path in unknown if (key := _near_key(document, path))}
    explained |= {(*path[:-1], "topic") for path in unknown if _is_signal(document, path)}
    found = [_action(document, path) for path in sorted(actions)]
    return found + [
        _finding(document, path, problem)
        for path, problem in zip(paths, problems, strict=True)
        if path[:2] not in actions and (problem["type"] != "missing" or path not in explained)
    ]


def _is_action(stream: object) -> bool:
    """Whether a stream is an action of ROS: it has that name where `log` or `filter` belongs."""
    name = stream.get("action") if isinstance(stream, dict) and not {*GROUPS} & stream.keys() else None
    return isinstance(name, str) and name not in ("log", "filter")


def _action(document: Document, path: KeyPath) -> Finding:
    name = str(at(document.value, (*path, "action")))
    message = f"`action` says `log` or `filter`; an action of ROS is observed as `ros_action: {name}`"
    return Finding(document.file, *document.key_place((*path, "action")), f"stream '{name}': {message}")


def place_name(document: Document, path: KeyPath) -> str:
    """What stands before a message: the stream or property that a path is in, empty elsewhere."""
    if len(path) > 1 and path[0] in ("ordering", "retention", "episodes"):
        return f"{path[0]}: "
    if len(path) > 1 and path[0] == "derive":
        return f"derived signal '{path[1]}': "
    if len(path) < 2 or path[0] not in ("streams", "properties") or not isinstance(path[1], int):
        return ""
    value = at(document.value, path[:2])
    names = (*GROUPS, "id") if path[0] == "streams" else ("id",)
    name = next((value[key] for key in names if isinstance(value.get(key), str)), None) if is_map(value) else None
    noun = "stream" if path[0] == "streams" else "property"
    half = f" {path[2]}" if len(path) > 3 and path[2] in PARTS else ""
    return f"{noun} '{name}'{half}: " if name is not None else f"{noun} {path[1] + 1}{half}: "


def _finding(document: Document, path: KeyPath, problem: Any) -> Finding:
    where = place_name(document, path)
    if "[key]" in problem["loc"]:
        message = f"{where}{_short(path[-1])} can't be a name here; a name has 1 to 128 characters"
        return Finding(document.file, *document.key_place(path), message)
    if problem["type"] == "extra_forbidden":
        return Finding(document.file, *document.key_place(path), f"{where}{_unknown(document, path)}")
    if problem["type"] == "missing":
        return Finding(document.file, *document.place(path[:-1]), f"{where}{_missing(path)}")
    if not path:
        message = f"a spec is a mapping of keys, the first of which is `id: my_spec`; found {_found(problem['input'])}"
        return Finding(document.file, *document.place(path), message)
    return Finding(document.file, *document.place(path), f"{where}{_value(document, path, problem)}")


def _unknown(document: Document, path: KeyPath) -> str:
    key = str(path[-1])
    if _is_signal(document, path):
        text = at(document.value, path)
        below, _ = _BELOW.get(_level(document, path[:-1]), ("", None))
        half = f"{below}, and there " if below else ""
        mend = f"deeper than it, as `signals: {{{key}: {text}}}`"
        return f"unknown key '{key}': a signal stands below {half}`signals:`, {mend}"
    meant = _near_key(document, path)
    if meant:
        return f"unknown key '{key}'; did you mean `{meant}`?"
    level = _level(document, path[:-1])
    if path[0] == "streams" and key in ("filter", "enforce", "block", "deny"):
        return f"unknown key '{key}'; write `action: filter`"
    others = [name for name, model in _LEVELS.items() if key in model.model_fields and name != level]
    if level in _BELOW and key in _BELOW[level][1].model_fields:
        return f"unknown key '{key}': of {level} it stands under {_BELOW[level][0]}"
    if others:
        return f"unknown key '{key}': it belongs to {' or '.join(others)}, and not to {level}"
    fields = _LEVELS[level].model_fields
    listed = [*(name for name in _FIRST if name in fields), *(name for name in fields if name not in _FIRST)]
    return f"unknown key '{key}'; {level} has {', '.join(listed)}"


def _is_signal(document: Document, path: KeyPath) -> bool:
    """Whether an unknown key of a stream has an expression, as a signal that is not indented enough has."""
    text = at(document.value, path)
    return path[0] == "streams" and isinstance(text, str) and re.search(r"\bmsg\b", text) is not None


def _near_key(document: Document, path: KeyPath) -> str | None:
    """The key that a misspelt one is likely to mean."""
    model = _LEVELS[_level(document, path[:-1])]
    meant = _KEYS_MEANT.get(_level(document, path[:-1]), {}).get(str(path[-1]).lower())
    return meant or next(iter(near(str(path[-1]), model.model_fields, 0.7)), None)


def _level(document: Document, path: KeyPath) -> str:
    match path:
        case ("ordering" | "retention" | "episodes" as key, *_):
            return f"`{key}`"
        case ("streams", int(), *below):
            value = at(document.value, path[:2])
            group = next((group for group in ("service", ACTION) if is_map(value) and group in value), "topic")
            inner = str(below[0]) if below else ""
            return _INSIDE.get((group, inner)) or _INSIDE.get(("", inner)) or NOUNS[group]
        case ("properties" | "derive" as key, _, *_):
            return "a property" if key == "properties" else "a derived signal"
    return "the file"


def _missing(path: KeyPath) -> str:
    key = path[-1]
    if key == "topic":
        return (
            "the key 'topic' is missing, or `service` or `ros_action`: write what it observes, as `- topic: /cmd_vel`"
        )
    if key == "id":
        return "the key 'id' is missing: write a name, as `id: speed_limit`"
    if key == "streams":
        return f"the key 'streams' is missing: write {_STREAMS}"
    return f"the key '{key}' is missing: write {_TAKES.get(str(key), 'it')}"


def _value(document: Document, path: KeyPath, problem: Any) -> str:
    """What is wrong with a value."""
    names = [p for p in path if isinstance(p, str) and p not in ("streams", "properties")] or [str(path[0])]
    key = names[-1] if not isinstance(path[-1], int) else f"{names[-1]}[{path[-1]}]"
    value = at(document.value, path) if key == "type" else problem["input"]
    if problem["type"] == "literal_error":
        return _word(key, value, problem["ctx"]["expected"])
    if problem["type"] == "value_error" and isinstance(value, str | int | float) and not isinstance(value, bool):
        return f"`{key}`: {problem['ctx']['error']}"
    if len(path) == 2 and path[0] in ("streams", "properties"):
        first = "topic: /name" if path[0] == "streams" else "id: name"
        return f"it is a mapping that begins with `- {first}`; found {_found(value)}"
    return f"`{key}` must be {_takes(path)}; found {_found(value)}{mend(document, path, value)}"


def _takes(path: KeyPath) -> str:
    if path == ("streams",):
        return _STREAMS
    if path[-1] == "streams" or (isinstance(path[-1], int) and path[-2] in ("guards", "causes", "streams")):
        return _NAMES if path[-1] == "streams" else "a ROS name such as /cmd_vel"
    if isinstance(path[-1], int):
        return "the name of a signal"
    if len(path) == 2 and path[0] == "define":
        return _TAKES["formula"]
    if len(path) >= 2 and path[-2] == "signals":
        return "an expression in quotes, such as 'msg.data'"
    own = {2: _DERIVED, 3: _DERIVING.get(str(path[-1]))}.get(len(path)) if path[0] == "derive" else None
    return own or _TAKES.get(str(path[-1]), "something else")


def _word(key: str, value: object, expected: object) -> str:
    """What is wrong with a value that is none of some words."""
    words = re.findall(r"'([^']*)'", str(expected))
    meant = next((word for word in _MEANT.get(str(value).lower(), "").split() if word in words), "")
    if key == "unit":
        meant = UNITS.get(str(value).lower(), "")
    hint = nearest(str(value), words, 0.7) or (f"did you mean `{meant}`?" if meant in words else "")
    if key == "time" and meant == "seconds":
        hint = "write `seconds`, and a unit in each bound, as `once[:500ms]`"
    found = f"`{key}` must be {', '.join(words[:-1])} or {words[-1]}; found {_found(value)}"
    return f"{found}; {hint}" if hint else found


def _without_tags(loc: KeyPath) -> KeyPath:
    """A path in the file of a path in the model, which also names the kind of a stream and calls keys `[key]`."""
    return tuple(_parts(loc))


def _parts(loc: KeyPath) -> Iterator[str | int]:
    for i, part in enumerate(loc):
        if part != "[key]" and not (part in GROUPS and i == 2 and loc[0] == "streams"):
            yield part


def _found(value: object) -> str:
    """A value as its author knows it."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return f"a mapping of {', '.join(map(str, value))}"[:60] if value else "an empty mapping"
    if isinstance(value, list):
        return f"a list of {len(value)}" if value else "an empty list"
    return _short(value)


def _short(value: object) -> str:
    text = f"'{value}'" if isinstance(value, str) else str(value)
    return text if len(text) <= 60 else text[:60] + "…"
