"""Who publishes and serves what, according to the master."""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from functools import partial
from typing import Any, Callable, Dict, FrozenSet, List, Optional, Sequence, Set, Tuple
from xmlrpc.client import ServerProxy

import rosgraph
import rospy
from oracle_adapter.monitors import doubtful, errors_among, other_origins
from rospy.impl import paramserver, registration

from oracle_ros1.forgotten import Forgotten
from oracle_ros1.timed import TimedTransport

ASK_PERIOD = 1.0
"""Seconds between two requests to the master."""
REPLY_WITHIN = 10.0
"""Seconds that the master may take to answer a request."""
SILENT_AFTER = 5.0
"""Seconds without an answer after which it is said that the master does not answer."""
ASK_WITHIN = 1.0
"""Seconds that it may take while a message waits for the answer, or a node."""
ASK_AGAIN = 0.05
"""Seconds between two requests about nodes that the master did not know when it was asked in turn."""
MOST_KNOWN = 10_000
"""Nodes that are remembered; many tools have another name at each start."""

Users = Dict[str, List[str]]
"""The nodes by the topics or services that they use."""
Register = Callable[[str, str, str], Any]
"""Registers a name, of a type or at an address, for the node at an address."""
NOISE = ("/rosout", "/rosout_agg")
SERVICES = ("/get_loggers", "/set_logger_level")  # that every node has


def master_proxy(seconds: float = REPLY_WITHIN) -> Any:
    """The master, as `rospy.get_master` has it, but on a connection of its own and with a time limit.

    Its methods raise OSError where there is no master, or no answer in time.
    """
    uri = rosgraph.get_master_uri()
    master = rospy.msproxy.MasterProxy(uri)
    master.target = ServerProxy(uri, transport=TimedTransport(seconds))
    return master


def log_without_master() -> None:
    """Have rospy ask the master once what it asks before each line that it logs.

    Else a thread that logs would wait for a master that hangs, and a node that another one of its name has replaced
    would be known to the master again, which ends the other one.
    """
    name = "/rosout_disable_topics_generation"
    paramserver.get_param_server_cache().set(name, bool(rospy.get_param(name, False)))


def dump_graph() -> Dict[str, Any]:
    """The graph without this node, as `oracle-server check --ros-graph` reads it: types by the names of topics.

    ROS 1 does not know who calls a service.
    """
    master = master_proxy()
    _, _, types = master.getTopicTypes()
    _, _, (publishers, subscribers, services) = master.getSystemState()
    kinds = {topic: [kind] for topic, kind in types}
    nodes: Dict[str, Any] = {}
    for key, entries in (("publishes", publishers), ("subscribes", subscribers), ("serves", services)):
        for name, users in entries:
            if name in NOISE or (key == "serves" and name.endswith(SERVICES)):
                continue
            for user in users:
                blank: Dict[str, Any] = {"name": user, "publishes": {}, "subscribes": {}, "serves": {}, "calls": {}}
                nodes.setdefault(user, blank)[key][name] = kinds.get(name, [])
    nodes.pop(rospy.get_name(), None)
    return {"nodes": [nodes[name] for name in sorted(nodes)]}


class Graph:
    """Asks in a thread of its own, from `start` to `stop`: a master can be far away, and nothing must wait for it."""

    def __init__(self) -> None:
        self.answers = 0
        """How many the master has given."""
        self.monitors: FrozenSet[str] = frozenset()
        """The nodes that were monitors when the master was last asked."""
        self.doubtful: Dict[str, str] = {}
        """Those of them that may be none, each with its topic of errors."""
        self._known: Set[str] = set()  # nodes that the master has told of when it was asked in turn
        self._unknown = threading.Lock()  # held while the master is asked about another one
        self._asked_again = 0.0
        self._publishers: Users = {}
        self._subscribers: Users = {}
        self._asked: Set[str] = set()  # nodes whose addresses are wanted
        self._addresses: Dict[str, str] = {}
        self._given: Set[str] = set()  # topics that no other node is to publish
        self._forgotten = Forgotten()
        self._unheard: Set[str] = set()  # topics of which a publisher is to be connected to again
        self._unconnected: Set[str] = set()  # topics that were registered again, whose publishers may not be known here
        self._servers: Optional[Users] = None
        self._answered = time.monotonic()  # when the master last did (s)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._ask, name="oracle-graph", daemon=True)

    def start(self) -> None:
        """Begin to ask."""
        self._answered = time.monotonic()
        self._thread.start()

    def stop(self) -> None:
        """Ask no more, and register nothing again."""
        self._stopping.set()

    def leave(self) -> None:
        """Wait until nothing is registered again."""
        self._thread.join(ASK_PERIOD)  # longer only where the master hangs

    @property
    def silence(self) -> str:
        """What is not known while the master does not answer; empty where it does."""
        if time.monotonic() - self._answered < SILENT_AFTER:
            return ""
        return (
            f"the master at {rosgraph.get_master_uri()} does not answer: who publishes from now on is not heard, and "
            "who publishes or serves past the monitor is not seen"
        )

    def past(self, topic: str) -> List[str]:
        """Who but this node published a topic of its own when the master was last asked, each in a text.

        The master has names as ROS's remaps of this node make them.
        """
        topic = rospy.resolve_name(topic)
        self._given.add(topic)
        return [f"{node} publishes {topic} past the monitor" for node in self.publishers(topic)]

    def unguarded(self, heard: str, given: str) -> str:
        """Who hears what this node does, where nobody hears what passes: as where a remap is missing; else empty.

        That is as of when the master was last asked, which may know neither.
        """
        heard, given = rospy.resolve_name(heard), rospy.resolve_name(given)
        others = self.subscribers(heard)
        if not others or self._subscribers.get(given):
            return ""
        return f"nobody hears {given}, and past the monitor hears {heard}: {', '.join(others)}"

    def giving_back(self, heard: str, given: str) -> FrozenSet[str]:
        """The other monitors that heard what this node gives, and gave what it hears, as last read from the master."""
        heard, given = rospy.resolve_name(heard), rospy.resolve_name(given)
        found = self.monitors.intersection(self.publishers(heard), self.subscribers(given))
        return found.difference(*map(self.subscribers, other_origins(heard, given)))

    def publishers(self, topic: str) -> List[str]:
        """The nodes but this one that published a topic when the master was last asked."""
        return sorted(set(self._publishers.get(topic, ())) - {rospy.get_name()})

    def subscribers(self, topic: str) -> List[str]:
        """The nodes but this one that subscribed to a topic when the master was last asked."""
        return sorted(set(self._subscribers.get(topic, ())) - {rospy.get_name()})

    def connect_again(self, topic: str) -> None:
        """Connect to the publishers of a topic that are not connected: rospy tries none again that hung up at first."""
        self._unheard.add(topic)

    def address(self, node: str) -> str:
        """Where the master has a node; empty until it is asked next, for what is still wanted then."""
        self._asked.add(node)
        return self._addresses.get(node, "")

    def published(self) -> List[str]:
        """The topics that other nodes than this one published when the master was last asked."""
        own = rospy.get_name()
        return [topic for topic, nodes in self._publishers.items() if set(nodes) - {own}]

    def is_served(self, service: str) -> bool:
        """Whether another node served a service when the master was last asked."""
        return any(node != rospy.get_name() for node in (self._servers or {}).get(service, ()))

    def served(self) -> List[str]:
        """The services that other nodes served when the master was last asked, but those that every node has."""
        return [name for name in self._servers or () if self.is_served(name) and not name.endswith(SERVICES)]

    def is_monitor(self, node: str) -> bool:
        """Whether a node is a monitor.

        Of one of which the master has not told yet it is asked at once: what a monitor says first is none of the
        robot's either.
        """
        if node not in self._known:
            with self._unknown:
                if time.monotonic() - self._asked_again >= ASK_AGAIN:
                    with suppress(Exception):  # no master, or a reply that can't be read
                        _, _, (publishers, _, _) = master_proxy(ASK_WITHIN).getSystemState()
                        self._note_monitors(dict(publishers))
                    self._asked_again = time.monotonic()
        return node in self.monitors

    def not_serving(self, service: str) -> str:
        """Why calls of a service of this node's do not reach it, as last read from the master; empty where they do.

        The name of a service is its last server's. Who calls a service is not known to the master.
        """
        if self._servers is None:
            return ""
        service = rospy.resolve_name(service)
        servers = self._servers.get(service, [])
        others = [
            f"{server} serves {service} in the monitor's place" for server in servers if server != rospy.get_name()
        ]
        return "; ".join(others) if servers else f"the master does not know {service} any more"

    def _ask(self) -> None:
        master = master_proxy()
        while not self._stopping.wait(ASK_PERIOD):
            with suppress(Exception):  # no master, or a reply that can't be read
                self._look(master)

    def _look(self, master: Any) -> None:
        _, _, state = master.getSystemState()
        publishers, subscribers, servers = (dict(entries) for entries in state)
        self._answered = time.monotonic()
        topics, services = registration.get_topic_manager(), registration.get_service_manager()
        own, subscribe = rospy.get_name(), partial(self._subscribe, master)
        missing = [
            *((master.registerPublisher, *p) for p in topics.get_publications() if own not in publishers.get(p[0], ())),
            *(
                (subscribe, *s)
                for s in topics.get_subscriptions()
                if own not in subscribers.get(s[0], ()) or s[0] in self._unconnected
            ),
            # a service that another node serves by now stays that one's
            *((master.registerService, *s) for s in services.get_services() if not servers.get(s[0])),
        ]
        if missing:  # the master was restarted; of those whose addresses were wanted it is known where to ask
            for node, address in self._addresses.items():
                self._forgotten.add(
                    node, address, {topic for topic, nodes in self._publishers.items() if node in nodes}
                )
        for node, published in self._forgotten.look().items():
            for topic in published:
                publishers[topic] = [*publishers.get(topic, ()), node]
        asked, self._asked = self._asked, set()
        asked.update(node for topic in self._given for node in publishers.get(topic, ()))
        found = {node: master.lookupNode(node) for node in asked if node != own and node not in self._forgotten}
        self._addresses = {node: str(uri) for node, (code, _, uri) in found.items() if code == 1}
        self._publishers, self._subscribers, self._servers = publishers, subscribers, servers
        self._known = self._note_monitors(publishers).union(self._known if len(self._known) < MOST_KNOWN else ())
        self.answers += 1
        self._register_again(missing, master)
        unheard, self._unheard = self._unheard, set()
        again = [(name, kind) for name, kind in topics.get_subscriptions() if name in unheard]
        if again and not _is_replaced(master):
            for name, kind in again:
                if not self._stopping.is_set():
                    _connect(master, name, kind, rospy.get_node_uri())

    def _note_monitors(self, publishers: Users) -> Set[str]:
        """Take who is a monitor by who publishes what; returns all of these.

        One that a restarted master does not know yet stays one.
        """
        nodes = set().union(*publishers.values())
        errors = {topic: publishers[topic] for topic in errors_among(publishers)}
        self.monitors = frozenset(self.monitors - nodes).union(*errors.values())
        self.doubtful = doubtful(errors)
        return nodes

    def _subscribe(self, master: Any, name: str, kind: str, uri: str) -> None:
        self._unconnected.add(name)  # the master may know it, and its answer be lost
        _connect(master, name, kind, uri)
        self._unconnected.discard(name)

    def _register_again(self, missing: Sequence[Tuple[Register, str, str]], master: Any) -> None:
        """Register at the master what it lacks of this node, as after its restart: rospy never does that.

        Raises what the master raises; what is missing then is found again.
        """
        if missing and _is_replaced(master):
            return  # the master would end the other node
        for register, name, kind in missing:
            if self._stopping.is_set() or rospy.core.is_shutdown_requested():
                return
            register(name, kind, rospy.get_node_uri())
        if missing:
            rospy.logwarn(f"the master did not know {len(missing)} topics and services of this node: registered again")


def _connect(master: Any, name: str, kind: str, uri: str) -> None:
    """Register a subscriber, and connect it to the publishers of its topic that it has no connection to."""
    _, _, publishers = master.registerSubscriber(name, kind, uri)
    node: Any = ServerProxy(uri, transport=TimedTransport(ASK_WITHIN))  # it may not be reached where it says it is
    node.publisherUpdate("/master", name, publishers)  # as the master does for those that come later


def _is_replaced(master: Any) -> bool:
    """Whether the master has another node by this one's name."""
    code, _, uri = master.lookupNode(rospy.get_name())
    return bool(code == 1 and uri != rospy.get_node_uri())
