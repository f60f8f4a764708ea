"""Topics: those that are only observed, and those whose messages pass when the oracle allows it.

Messages are taken as they were sent: any topic can be observed, and what is forwarded is byte for byte what came.
"""

from __future__ import annotations

from typing import Dict, FrozenSet, Optional, Tuple, Union

import rospy
from oracle_adapter import PROXY
from oracle_adapter.forwarding import ForwardQueue
from oracle_adapter.interfaces import Interface
from oracle_adapter.monitors import OWN, circle_text, doubt_text, refuse_own
from oracle_adapter.passing import Passing
from oracle_adapter.unpublished import Unpublished

from oracle_ros1.headers import Header, header_of, headers, node_of
from oracle_ros1.latches import Latches, latching
from oracle_ros1.observed import Decoder, Observed, deafen
from oracle_ros1.shared import Shared
from oracle_ros1.slow import DEPTH, keep_room
from oracle_ros1.unheard import Ungiven, Unheard


class LoggedTopic:
    """Reports every message of a topic, but for those of monitors on `OWN`."""

    bypass = ""

    def __init__(self, shared: Shared, topic: Interface) -> None:
        self._link, self._observed = shared.link, Observed(topic.first, shared.now, shared.frame)
        self.streams = [self._observed]
        self._graph, name = shared.graph, rospy.resolve_name(shared.names[topic.name])
        self._has_monitors, self._doubt = name in map(rospy.resolve_name, OWN), ""
        self._silence, self._missing = Unpublished(name), Unheard(shared.graph)
        self._subscriber = rospy.Subscriber(shared.names[topic.name], rospy.AnyMsg, self._take, tcp_nodelay=True)

    def look(self) -> str:
        """Read its publishers' connection headers, and return what is wrong."""
        publishers = headers(self._subscriber)
        self._link.lost(self._observed.overdue())
        self._silence.look(lambda: bool(publishers), self._graph.published)
        if self._has_monitors:
            others = {node_of(header) for header in publishers} - {rospy.get_name()}
            self._doubt = doubt_text(self._graph.doubtful, others)
        return "; ".join([*self._observed.troubles(publishers), *self._missing.look([self._subscriber])])

    @property
    def doubt(self) -> str:
        """That nobody publishes it, as of the last look, or who is left out that may be no monitor."""
        return self._silence.text or self._doubt

    def stop(self) -> None:
        """Take no more."""
        deafen(self._subscriber)

    def leave(self) -> None:
        """Unregister at the master."""
        self._subscriber.unregister()

    def _take(self, message: rospy.AnyMsg) -> None:
        header = header_of(message)
        source = header.get("callerid")
        if self._has_monitors and source and (source == rospy.get_name() or self._graph.is_monitor(source)):
            return
        decoder = self._observed.decoder(header)
        if isinstance(decoder, str):
            self._observed.refuse(header, decoder)
            return
        event = self._observed.event(message, decoder)
        if event is not None:
            stamp, data, lost = event
            self._link.send(self._observed.name, self._observed.kind, stamp, data, source=source, lost=lost)


class FilteredTopic:
    """Forwards the messages that the oracle allows, in their order; no callback waits for a decision.

    `intercept: publisher` takes X_mon and gives X, `subscriber` takes X and gives X_mon. What it gives can be
    subscribed to at once where the type is installed, else from the moment that the first publisher has connected.
    """

    def __init__(self, shared: Shared, topic: Interface) -> None:
        stream = topic.first
        self._link, self._graph = shared.link, shared.graph
        self._observed = Observed(stream, shared.now, shared.frame)
        self.streams = [self._observed]
        name, proxy = shared.names[topic.name], shared.names[topic.name + PROXY]
        taken, self._given = (proxy, name) if stream["intercept"] == "publisher" else (name, proxy)
        refuse_own(topic.name, rospy.resolve_name(taken), map(rospy.resolve_name, OWN))
        self._taken, self._unguarded, self._unreached = taken, "", ""
        self._silence, self._missing = Unpublished(rospy.resolve_name(taken)), Unheard(shared.graph)
        self._ungiven = Ungiven(shared.graph)
        passing = Passing(shared.link, shared.board, stream, shared.clocks)
        self._queue = ForwardQueue(passing, self._forward, size=_size)
        self._latches = Latches(lambda: headers(self._subscriber))
        self._publisher: Optional[rospy.Publisher] = None
        self._stopped = False
        self.bypass = ""
        """Who publishes past the monitor what it forwards, or gives it back."""
        self._giving_back: FrozenSet[str] = frozenset()  # monitors whose messages would come again, for ever
        self._ready: Dict[int, Tuple[Header, Decoder]] = {}  # by the header's id: that of one connection
        with self._latches.lock:  # what comes at once waits for the subscriber
            if self._observed.installed:
                self._publish(self._observed.installed)
            self._subscriber = rospy.Subscriber(taken, rospy.AnyMsg, self._take, tcp_nodelay=True)

    def look(self) -> str:
        """Read its publishers' connection headers, and return what is wrong.

        What it gives is published from here on, so that there are subscribers before the first message.
        """
        publishers = headers(self._subscriber)
        self._link.lost(self._observed.overdue())
        self._silence.look(lambda: bool(publishers), self._graph.published)
        found = [self._prepared(header) for header in publishers]
        self._latches.forget()
        if self._publisher is not None:
            self._publisher.impl.add_headers({"latching": latching(publishers)})
        troubles = [why for why in found if isinstance(why, str)]
        troubles += [why for why in self._observed.troubles(publishers) if why not in troubles]
        troubles += self._missing.look([self._subscriber])
        self._unreached = self._ungiven.look(self._publisher)
        self._unguarded = self._graph.unguarded(self._taken, self._given)
        self._giving_back = self._graph.giving_back(self._taken, self._given)
        circle = circle_text(self._giving_back, rospy.resolve_name(self._taken), rospy.resolve_name(self._given))
        past = [*self._graph.past(self._given), *filter(None, [circle])]
        self.bypass = "; ".join(past)
        return "; ".join([*troubles, *past])

    @property
    def doubt(self) -> str:
        """That nobody publishes what it takes, or hears what passes, or not all, as of the last look."""
        return "; ".join(filter(None, (self._unguarded, self._unreached, self._silence.text)))

    def stop(self) -> None:
        """Take and forward no more."""
        deafen(self._subscriber)
        self._stopped = True

    def leave(self) -> None:
        """Unregister at the master."""
        self._subscriber.unregister()
        with self._latches.lock:
            if self._publisher is not None:
                self._publisher.unregister()

    def _take(self, message: rospy.AnyMsg) -> None:
        header = header_of(message)
        if header.get("callerid") in self._giving_back:
            return
        decoder = self._prepared(header)
        if isinstance(decoder, str):
            self._observed.refuse(header_of(message), decoder)
            return
        event = self._observed.event(message, decoder)
        if event is not None:
            stamp, data, lost = event
            self._queue.take(message, stamp, data, source=header.get("callerid"), lost=lost)

    def _prepared(self, header: Header) -> Union[Decoder, str]:
        """What decodes the messages of a publisher, now that they can be given, or why they can't."""
        ready = self._ready.get(id(header))
        if ready is not None and ready[0] is header:
            return ready[1]
        decoder = self._observed.decoder(header)
        if isinstance(decoder, str):
            return decoder
        publisher = self._publish(decoder)
        if publisher.md5sum != decoder.digest:
            return f"{node_of(header)} publishes another version of {header.get('type')} than is given"
        self._ready = {**self._current(), id(header): (header, decoder)}
        return decoder

    def _current(self) -> Dict[int, Tuple[Header, Decoder]]:
        """What is ready of the connections that there are."""
        there = {id(header) for header in headers(self._subscriber)}
        return {key: ready for key, ready in self._ready.items() if key in there}

    def _publish(self, decoder: Decoder) -> rospy.Publisher:
        """Give messages of this definition, unless others are given that somebody publishes, or that are installed."""
        with self._latches.lock:
            if self._publisher is not None and self._is_over(self._publisher.md5sum, decoder.digest):
                self._publisher.unregister()
                self._publisher = None
            if self._publisher is None:
                self._publisher = rospy.Publisher(
                    self._given, decoder.definition.type, self._latches, tcp_nodelay=True, queue_size=DEPTH
                )
            return self._publisher

    def _is_over(self, given: str, wanted: str) -> bool:
        """Whether another version takes the place of what is given, as where a node was built anew and started again.

        That of the installed one it never takes: rospy's subscribers do not come again to who has refused them.
        """
        if self._observed.installed or given == wanted:
            return False
        return all(header.get("md5sum") != given for header in headers(self._subscriber))

    def _forward(self, message: rospy.AnyMsg) -> bool:
        with self._latches.lock:
            if self._stopped or self._publisher is None or self._publisher.md5sum != header_of(message).get("md5sum"):
                return False  # what is given has changed while it was decided on
            try:
                self._publisher.publish(message)
            except rospy.ROSException:  # ROS is shut down, as by `rosnode kill`
                return False
            keep_room(self._publisher, _size(message))
            self._latches.passed(message)
            return True


def _size(message: rospy.AnyMsg) -> int:
    """How many bytes a message takes."""
    return len(message._buff)  # noqa: SLF001 - rospy's own interface
