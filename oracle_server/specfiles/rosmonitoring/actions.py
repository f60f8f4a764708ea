"""Actions of a configuration: those that it names, and those whose hidden services or feedback it names."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence

from oracle_server.core.kinds import OF_ACTIONS, Kind
from oracle_server.specfiles.model import ros_type
from oracle_server.specfiles.rosmonitoring.cel import FAILS, TODO
from oracle_server.specfiles.rosmonitoring.config import Interface
from oracle_server.specfiles.rosmonitoring.draft import Draft, streams_of
from oracle_server.specfiles.rosmonitoring.streams import Stream

_HIDDEN = re.compile(r"(?P<action>.+)/_action/(?P<service>send_goal|get_result|cancel_goal|feedback)")
_OF_SERVICES: Mapping[tuple[str, str], tuple[Kind, str]] = {
    ("send_goal", "request"): ("goal", "goal."),
    ("send_goal", "response"): ("reply", ""),
    ("get_result", "response"): ("result", "result."),
    ("cancel_goal", "request"): ("cancel", "goal_info."),
    ("feedback", "topic"): ("feedback", "feedback."),
}
"""Of the halves of the hidden services, and of the topic, the kinds of events, and the fields with their messages."""
_ASKED: tuple[Kind, ...] = ("goal", "reply", "result")
"""What is decided where a filter decided everything: a robot must be stopped, and feedback come at once."""


def action_of(interface: Interface) -> str:
    """The action that an interface is, or is a hidden part of; empty for none."""
    if interface.kind == "action":
        return interface.name
    match = _HIDDEN.fullmatch(interface.name)
    own = match is not None and (match["service"] == "feedback") == (interface.kind == "topic")
    return match["action"] if match and own else ""


def action_lines(interfaces: Sequence[Interface], draft: Draft, common: Sequence[str]) -> list[str]:
    """The stream of an action of these interfaces; `common` are the lines of the keys that all streams have."""
    kinds, asked = _kinds(interfaces), _asked(interfaces)
    type_ = next(filter(None, map(_type, interfaces)), "")
    lines = [f"  - ros_action: {action_of(interfaces[0])}", *([f"    type: {type_}"] if type_ else []), *common]
    if asked:
        lines += [
            "    action: filter",
            f"    ask: [{', '.join(asked)}]   # feedback and cancels pass, unless they are asked",
        ]
    for kind in (kind for kind in OF_ACTIONS if kind in kinds or kind in asked):
        streams = list(_streams(kind, interfaces))
        inside = [line for stream, field in streams for line in _signals(stream, field, draft)]
        hold = [name for name, signal in draft.signals.items() if any(signal.hold == stream for stream, _ in streams)]
        if inside:
            held = [f"      hold: [{', '.join(json.dumps(name) for name in hold)}]"] if hold else []
            lines += [f"    {kind}:", *held, "      signals:", *inside]
        else:
            lines.append(f"    {kind}: {{{'signals: {}' if draft.properties else ''}}}")
    return lines


def lost_of(interfaces: Sequence[Interface], draft: Draft) -> Iterator[str]:
    """What the modules read of an action that has no counterpart."""
    for interface in interfaces:
        match = _HIDDEN.fullmatch(interface.name)
        for stream in streams_of(interface) if match else ():
            read = [name for name, signal in draft.signals.items() if stream in signal.cel or stream in signal.unread]
            if read and match and (match["service"], stream.kind) not in _OF_SERVICES:
                yield f"{', '.join(read)} of the {stream.kind}s of {interface.name}, which are no events"


def _kinds(interfaces: Sequence[Interface]) -> set[Kind]:
    found: set[Kind] = set()
    for interface in interfaces:
        match = _HIDDEN.fullmatch(interface.name)
        if match:
            found |= {kind for (service, _), (kind, _) in _OF_SERVICES.items() if service == match["service"]}
        else:
            found |= set(interface.observed)
    return found


def _asked(interfaces: Sequence[Interface]) -> list[Kind]:
    kinds = _kinds([interface for interface in interfaces if interface.filtered])
    return [kind for kind in _ASKED if kind in kinds]


def _type(interface: Interface) -> str:
    if interface.kind == "action":
        return ros_type(interface.type, "action") if interface.type else ""
    match = re.fullmatch(r"(\w+)[./]action[./](\w+)_(?:SendGoal|GetResult|FeedbackMessage)", interface.type)
    return f"{match[1]}/action/{match[2]}" if match else ""


def _streams(kind: Kind, interfaces: Sequence[Interface]) -> Iterator[tuple[Stream, str]]:
    """The streams that are of a kind, and the fields that their messages are in.

    Those of hidden services and topics leave out the action's own: its events are theirs.
    """
    hidden, own = list[tuple[Stream, str]](), list[tuple[Stream, str]]()
    for interface in interfaces:
        match = _HIDDEN.fullmatch(interface.name)
        for stream in streams_of(interface):
            if match is None:
                own += [(stream, "")] if stream.kind == kind else []
                continue
            found, field = _OF_SERVICES.get((match["service"], stream.kind), ("", ""))
            hidden += [(stream, field)] if found == kind else []
    yield from hidden or own


def _signals(stream: Stream, field: str, draft: Draft) -> Iterator[str]:
    """The signals of a stream: expressions over its messages become some over what is in a field of them."""
    indent = " " * 8
    for name, signal in draft.signals.items():
        was = signal.cel.get(stream) or signal.unread.get(stream)
        if was is None:
            continue
        cel = _inside(was, field) if stream in signal.cel else None
        if cel == FAILS:
            yield f"{indent}# the module fails here, so that its formulas are unknown"
        elif cel is None and not was:
            yield f"{indent}# unknown here too, until `{name}` is written"
        elif cel is None:
            yield f"{indent}# TODO: write this as CEL over `msg`, which is the inner message here. It was:"
            yield from (f"{indent}# {line}" for line in was.splitlines())
        yield f"{indent}{json.dumps(name)}: {json.dumps(TODO if cel is None else cel)}"


def _inside(cel: str, field: str) -> str | None:
    """An expression over a message as one over the message in its field, None where it reads others, too."""
    read = len(re.findall(r"\bmsg\b", cel))
    if field and read != len(re.findall(rf"\bmsg\.{re.escape(field)}", cel)):
        return None
    if read and not field and re.search(r"\bmsg\b(?!\.(accepted|stamp)\b)", cel):
        return None
    return re.sub(rf"\bmsg\.{re.escape(field)}", "msg.", cel) if field else cel
