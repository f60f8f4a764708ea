"""Reads a dump of a ROS graph, as an adapter writes it: what each node publishes, subscribes, serves and calls."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from oracle_server.core.errors import OracleError
from oracle_server.core.hazards.dependencies import GraphNode

_SEND = "/_action/send_goal"
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
    return tuple(map(_node, graph.nodes))


def _node(node: _Node) -> GraphNode:
    """A node as it is in the graph: to send goals to an action is to call it, and to take them is to serve it."""
    calls = frozenset(node.calls) | _actions(node.calls) | _actions(node.publishes)
    serves = frozenset(node.serves) | _actions(node.serves) | _actions(node.subscribes)
    return GraphNode(node.name, frozenset(node.publishes), frozenset(node.subscribes), serves, calls)


def _actions(names: Mapping[str, list[str]]) -> frozenset[str]:
    """The actions whose goals go by some names: a hidden service of ROS 2, or a topic of ROS 1 by its type."""
    of_ros2 = {name.removesuffix(_SEND) for name in names if name.endswith(_SEND)}
    of_ros1 = {
        name.removesuffix("/goal")
        for name, types in names.items()
        if name.endswith("/goal") and any(type_.endswith("ActionGoal") for type_ in types)
    }
    return frozenset(of_ros2 | of_ros1)
