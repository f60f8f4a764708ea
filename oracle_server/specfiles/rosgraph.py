"""Reads a dump of a ROS graph, as an adapter writes it: what each node publishes, subscribes, serves and calls."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from oracle_server.core.dependencies import GraphNode
from oracle_server.core.errors import OracleError

_HINT = "make it with `python3 -m oracle_ros2 --dump-graph`"


class GraphError(OracleError):
    """A graph that can't be used."""


class _Node(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)

    name: str
    publishes: dict[str, list[str]] = {}
    subscribes: dict[str, list[str]] = {}
    serves: dict[str, list[str]] = {}
    calls: dict[str, list[str]] = {}


class _Graph(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)

    nodes: list[_Node]


def load_graph(path: Path) -> tuple[GraphNode, ...]:
    """The nodes of a dump. Raises `GraphError`."""
    try:
        graph = _Graph.model_validate_json(path.read_bytes())
    except OSError as error:
        raise GraphError(f"{path}: can't be read: {error.strerror}; {_HINT}") from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise GraphError(
            f"{path}: not a dump of a graph: {where + ': ' if where else ''}{first['msg']}; {_HINT}"
        ) from None
    return tuple(
        GraphNode(n.name, frozenset(n.publishes), frozenset(n.subscribes), frozenset(n.serves), frozenset(n.calls))
        for n in graph.nodes
    )
