"""Orderings that wait for ever: deadlocks and starvation with `max_delay: none`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise

from oracle_server.core.errors import SpecProblem
from oracle_server.core.hazards.dependencies import Edges, GraphNode, active, dependencies, paths
from oracle_server.core.spec import Spec

_MEND = "give `max_delay` an end, or take one of them out with `ordered: false`"


def deadlocks(spec: Spec, graph: Iterable[GraphNode] | None) -> Iterator[SpecProblem]:
    """A filtered ordered stream must not wait for a stream that depends on its own messages."""
    if spec.ordering.max_delay is not None:
        return
    edges = dependencies(spec, graph)
    ordered = {s.name for s in spec.streams if s.ordered}
    for i in sorted(spec.filtered.values()):
        stream = spec.streams[i]
        if not stream.ordered:
            continue
        for path in paths(stream.name, edges):
            if path[-1] in ordered:
                yield SpecProblem(("streams", i, "causes"), _words(path, edges))


def starvation(spec: Spec, graph: Iterable[GraphNode]) -> Iterator[SpecProblem]:
    """With `max_delay: none`, an ordered stream without events delays all others for ever."""
    ordered = [i for i, s in enumerate(spec.streams) if s.ordered and s.leads]
    if spec.ordering.max_delay is not None or len(ordered) < 2:
        return
    names = active(spec, graph)
    for i in ordered:
        stream = spec.streams[i]
        if stream.name not in names:
            yield SpecProblem(
                ("streams", i, stream.traits.group),
                f"starvation: no node of the graph {stream.traits.verb} {stream.name}, and all that is ordered waits "
                f"for it unless its monitor tells clocks; {_MEND}",
                severity="warning",
            )


def _words(path: tuple[str, ...], edges: Edges) -> str:
    """The cycle, in the terms of the ROSMonitoring 2.0 paper, and what to do about it."""
    start, end = path[0], path[-1]
    chain = " -> ".join((*path, start))
    nodes = {node: None for cause, effect in pairwise(path) if (node := edges[cause][effect])}
    by = f" (the graph has it by {', '.join(nodes)})" if nodes else ""
    return (
        f"deadlock: {chain}: a message on {start} waits in the order for {end}, which can't speak before that message "
        f"has passed{by}; {_MEND}"
    )
