"""Which streams depend on which others: as declared under `causes`, or as derived from a ROS graph."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from oracle_server.core.spec import Spec

Edges = Mapping[str, Mapping[str, str]]
"""By the name of a topic or service, what depends on it, and through which node (empty where it is declared)."""


@dataclass(frozen=True, slots=True)
class GraphNode:
    """A node of a ROS graph, and the names of its topics and services."""

    name: str
    publishes: frozenset[str] = field(default_factory=frozenset)
    subscribes: frozenset[str] = field(default_factory=frozenset)
    serves: frozenset[str] = field(default_factory=frozenset)
    calls: frozenset[str] = field(default_factory=frozenset)


def dependencies(spec: Spec, graph: Iterable[GraphNode] | None) -> Edges:
    """What depends on what, as the spec declares it and as the graph, where there is one, makes it possible."""
    edges: dict[str, dict[str, str]] = {}
    for node in (n for n in graph or () if not _is_monitor(n, spec)):
        for cause, effect in _possible(node, _originals(spec)):
            edges.setdefault(cause, {}).setdefault(effect, node.name)
    for stream in spec.streams:
        for effect in stream.causes:
            edges.setdefault(stream.name, {})[effect] = ""
    return edges


def paths(start: str, edges: Edges) -> Iterator[tuple[str, ...]]:
    """A shortest path from a name to each one that depends on it."""
    seen, todo = {start}, deque([tuple[str, ...]([start])])
    while todo:
        path = todo.popleft()
        for name in edges.get(path[-1], ()):
            if name not in seen:
                seen.add(name)
                todo.append((*path, name))
                yield (*path, name)


def active(spec: Spec, graph: Iterable[GraphNode]) -> frozenset[str]:
    """The names of the topics that some node publishes, and of the services that some node calls."""
    originals = _originals(spec)
    return frozenset(originals.get(n, n) for node in graph for n in node.publishes | node.calls)


def _possible(node: GraphNode, originals: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """What a node may publish or call only once it has received something: a message, a request, or a response."""
    for cause in sorted(node.subscribes | node.serves | node.calls):
        for effect in sorted(node.publishes | node.calls):
            pair = originals.get(cause, cause), originals.get(effect, effect)
            if pair[0] != pair[1]:
                yield pair


def _originals(spec: Spec) -> dict[str, str]:
    """The names in the spec, by the names that monitors put in between."""
    proxies = {s.proxy: s.name for s in spec.streams if s.proxied}
    return proxies | {f"{s.name}_mon": s.name for s in spec.streams if not s.proxied and s.action == "filter"}


def _is_monitor(node: GraphNode, spec: Spec) -> bool:
    """Whether a node is a monitor that forwards: it receives everything, and publishes nothing of its own."""
    proxies = {s.proxy for s in spec.streams if s.proxied}
    filtered = {s.name for s in spec.streams if not s.proxied and s.action == "filter"}
    forwards = any(
        {name, f"{name}_mon"} <= node.publishes | node.subscribes
        and not {name, f"{name}_mon"} <= node.publishes
        and not {name, f"{name}_mon"} <= node.subscribes
        for name in filtered
    )
    return forwards or not proxies.isdisjoint(node.serves)
