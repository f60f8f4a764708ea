"""The streams of a configuration, as a property module sees their messages."""

from __future__ import annotations

from dataclasses import dataclass, field

from oracle_server.core.typed import TypedMessage
from oracle_server.specfiles.rosmonitoring.values import Field


@dataclass(frozen=True, slots=True)
class Stream:
    """A stream as its messages show it: `key` is `topic` or `service`, under which they have its name.

    Of the events of an action, whose `key` is `action`, it is not known how they were written.
    """

    key: str
    name: str
    kind: str
    message: TypedMessage | None = field(default=None, compare=False, repr=False)
    """The shape of its messages, where that is known."""

    @property
    def whole(self) -> Field:
        """A message as a field that has its fields."""
        return Field(()) if self.message is None else Field((), self.message.shape, self.message.widest)

    def hides(self, key: str) -> bool:
        """Whether it is not known if its messages have a key: of an action's only that they are no other streams'."""
        return self.key == "action" and key not in ("topic", "service", "time")
