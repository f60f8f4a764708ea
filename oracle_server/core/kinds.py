"""The kinds of events, in one table: what sets the events of one kind apart from those of the others.

A new kind is a row of the table, a word of `Kind`, and the model of its section in spec files.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal, get_args

Kind = Literal["topic", "request", "response", "goal", "reply", "feedback", "cancel", "result", "status"]
"""The kind of a stream."""
LineKind = Literal[Kind, "tick"]
"""What a line of a trace is of: an event of a stream, or a deadline that has run out."""
StepKind = Literal[LineKind, "revision"]
"""What a row of the history is of: an event of a stream, a deadline that has run out, or a change of what stands."""
RecordKind = Literal[StepKind, "unavailable"]
"""The `kind` of a verdict record: `unavailable` where the adapter did not get a decision in time."""
TICK: Final = "tick"
REVISION: Final = "revision"
UNAVAILABLE: Final = "unavailable"
GOAL_ID: Final = "goal_id"
STATUS: Final = "status"
Status = Literal["accepted", "rejected", "executing", "canceling", "succeeded", "canceled", "aborted", "unknown"]
"""How a goal of an action stands."""
ACTION: Final = "ros_action"
"""The group of the kinds of actions."""
ACTIONS: Final = "actions"
"""The feature of monitors that know the kinds of actions."""


@dataclass(frozen=True, slots=True)
class Traits:
    """What holds for all events of one kind.

    `group` is the key that names their interface in spec files and in flat events, and the reserved signal that has
    the interface's name; it is empty for ticks, which no interface has. `noun` follows the name of the interface where
    the group has several kinds, and is empty where it has one. `verb` says what a node does to an interface of the
    group.

    `leads`: the first kind of its group. `has_call`: events may have the reserved signal `call`, the number of their
    call. `marks` are the reserved signals that each event has from its frame, beside its message. `undoable`: nobody
    has seen an event when it is denied, so that `on_deny: undo` can take it back. `proxied`: events can pass through a
    proxy in the adapter, which stamps them then. `feature` is what a monitor of such streams must say that it knows.
    """

    group: str
    noun: str = ""
    verb: str = ""
    leads: bool = False
    has_call: bool = False
    undoable: bool = False
    proxied: bool = False
    marks: tuple[str, ...] = ()
    feature: str = ""

    @property
    def sole(self) -> bool:
        """Whether the group has no other kind: a spec then describes the kind in the section of its interface."""
        return not self.noun


def _action(noun: str, *marks: str, leads: bool = False, has_call: bool = False, undoable: bool = False) -> Traits:
    return Traits(
        ACTION, noun, "sends goals to", leads, has_call, undoable, proxied=True, marks=(GOAL_ID, *marks),
        feature=ACTIONS,
    )  # fmt: skip


KINDS: Mapping[str, Traits] = {
    "topic": Traits("topic", verb="publishes", leads=True, undoable=True),
    "request": Traits("service", "requests", "calls", leads=True, has_call=True, undoable=True, proxied=True),
    "response": Traits("service", "responses", "calls", has_call=True, proxied=True),
    "goal": _action("goals", leads=True, has_call=True, undoable=True),
    "reply": _action("replies", STATUS, has_call=True),
    "feedback": _action("feedback", undoable=True),
    "cancel": _action("cancels", has_call=True),
    "result": _action("results", STATUS),
    "status": _action("status", STATUS),
    TICK: Traits("", "ticks"),
    REVISION: Traits("", "revisions"),
}
GROUPS = tuple(dict.fromkeys(traits.group for traits in KINDS.values() if traits.group))
"""The groups of kinds, each named by its key."""
NOUNS: Mapping[str, str] = {"topic": "a topic", "service": "a service", ACTION: "an action"}
"""What people call the interfaces of each group."""
OF_ACTIONS: tuple[Kind, ...] = tuple(kind for kind in get_args(Kind) if KINDS[kind].group == ACTION)
"""The kinds of an action's events."""
RESERVED = frozenset({"topic", "service", "kind", "monitor", "call"})
"""The signals that every event has, or may have, without its spec declaring them: no signal has one of these names."""
NAMING = RESERVED.union(GROUPS)
"""What in an atom says which events it is about."""
OWN: Mapping[str, frozenset[str]] = {
    group: RESERVED.union([group], *(traits.marks for traits in KINDS.values() if traits.group == group))
    for group in GROUPS
}
"""The names that no signal of a group's streams may have: other streams may have signals of the marks' names."""
STATUSES: tuple[str, ...] = get_args(Status)
