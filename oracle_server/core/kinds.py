"""The kinds of events, in one table: what sets the events of one kind apart from those of the others.

A new kind is a row of the table, a word of `Kind`, and the model of its section in spec files.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

Kind = Literal["topic", "request", "response"]
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


@dataclass(frozen=True, slots=True)
class Traits:
    """What holds for all events of one kind.

    `group` is the key that names their interface in spec files and in flat events, and the reserved signal that has
    the interface's name; it is empty for ticks, which no interface has. `noun` follows the name of the interface where
    the group has several kinds, and is empty where it has one. `verb` says what a node does to an interface of the
    group.

    `leads`: the first kind of its group. What a spec says of an interface as a whole is checked there, once.
    `has_call`: events may have the reserved signal `call`, the number of their call. `undoable`: nobody has seen an
    event when it is denied, so that `on_deny: undo` can take it back. `proxied`: events pass through a proxy in the
    adapter, which stamps them itself.
    """

    group: str
    noun: str = ""
    verb: str = ""
    leads: bool = False
    has_call: bool = False
    undoable: bool = False
    proxied: bool = False

    @property
    def sole(self) -> bool:
        """Whether the group has no other kind: a spec then describes the kind in the section of its interface."""
        return not self.noun


KINDS: Mapping[str, Traits] = {
    "topic": Traits("topic", verb="publishes", leads=True, undoable=True),
    "request": Traits("service", "requests", "calls", leads=True, has_call=True, undoable=True, proxied=True),
    "response": Traits("service", "responses", "calls", has_call=True, proxied=True),
    TICK: Traits("", "ticks"),
    REVISION: Traits("", "revisions"),
}
GROUPS = tuple(dict.fromkeys(traits.group for traits in KINDS.values() if traits.group))
"""The groups of kinds, each named by its key."""
RESERVED = frozenset({*GROUPS, "kind", "monitor", "call"})
"""The signals that every event has, or may have, without its spec declaring them."""
