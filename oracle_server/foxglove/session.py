"""One session as it is drawn live: its committed steps as messages of channels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from oracle_server.core.events import Order
from oracle_server.foxglove.channels import Channel, Message, Streams, log_channel, property_channel, verdict_message
from oracle_server.foxglove.episodes import told_message
from oracle_server.foxglove.listening import Listening, Offered
from oracle_server.history.records import StoredStep
from oracle_server.review.changes import Changes
from oracle_server.review.trace import event_line
from oracle_server.sessions.beginnings import Told


class Drawing:
    """Makes messages of a session's steps, and offers a channel for each that is new; their names begin with its id."""

    def __init__(
        self, session: str, properties: tuple[str, ...], orders: Sequence[Order], listening: Listening
    ) -> None:
        """Offer the log, and the properties in each order, the first of which decides, before anything comes."""
        self._properties, self._deciding, self._listening = properties, orders[0], listening
        self._prefix = f"/{session}"
        self._streams = Streams(self._prefix)
        self._changes = Changes(properties)
        self._offered: dict[tuple[str, str], Offered] = {}
        self._of(log_channel(self._prefix))
        for name in properties:
            for order in orders:
                self._of(property_channel(name, order, self._prefix))

    def take(self, steps: Sequence[StoredStep]) -> None:
        """Send what is told of the next steps of the history. To be called in a thread, by one at a time."""
        for step in steps:
            event = step.step.event
            if step.revision is None:
                self._streams.learn(event.stream.name, event.stream.kind, step.step.signals)
        for step in steps:
            for message in self._messages(step):
                self._of(message.channel).write(message)

    def tell(self, episodes: Sequence[Told], time: int) -> None:
        """Send what became of episodes, known at a time (ns). To be called as `take`."""
        for told in episodes:
            message = told_message(told, time, self._prefix)
            if message is not None:
                self._of(message.channel).write(message)

    def end(self) -> None:
        """Offer the session no longer."""
        for offered in self._offered.values():
            self._listening.withdraw(offered)
        self._offered = {}

    def _messages(self, step: StoredStep) -> Iterator[Message]:
        if step.revision is not None:
            return
        if step.order == self._deciding:
            yield self._streams.message(event_line(step))
        for record in self._changes.take([step]):
            yield verdict_message(record, self._prefix)

    def _of(self, channel: Channel) -> Offered:
        """A channel as it is offered: anew where it has another schema than before."""
        key = channel.topic, channel.metadata.get("kind", "")
        offered = self._offered.get(key)
        if offered is None or offered.schema is not channel.schema:
            if offered is not None:
                self._listening.withdraw(offered)
            offered = self._offered[key] = self._listening.offer(channel)
        return offered
