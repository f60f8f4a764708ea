"""Services and actions that nobody serves, as where a spec misspells them: what is called otherwise is not seen."""

from __future__ import annotations

from typing import List

import rospy
from oracle_adapter.unpublished import Unpublished

from oracle_ros1.graph import Graph

_STATUS = "/status"


class UnservedService:
    """Whether nobody has served a service since this began, by what the master knows."""

    def __init__(self, graph: Graph, service: str, proxy: str) -> None:
        self._graph, self._name = graph, rospy.resolve_name(service)
        self._silence = Unpublished(self._name, does="serves", proxy=rospy.resolve_name(proxy))

    def look(self) -> str:
        """That nobody has, as of now; empty where somebody has, or it is too early."""
        if self._graph.answers:  # else nobody knows
            self._silence.look(lambda: self._graph.is_served(self._name), self._graph.served)
        return self._silence.text


class UnservedAction:
    """Whether nobody has served an action since this began: who does publishes its status."""

    def __init__(self, graph: Graph, action: str, proxy: str = "") -> None:
        self._graph, self._status = graph, rospy.resolve_name(action + _STATUS)
        shown = rospy.resolve_name(proxy + _STATUS)[: -len(_STATUS)] if proxy else ""
        self._silence = Unpublished(self._status[: -len(_STATUS)], does="serves", proxy=shown)

    def look(self) -> str:
        """That nobody has, as of now; empty where somebody has, or it is too early."""
        if self._graph.answers:  # else nobody knows
            self._silence.look(lambda: bool(self._graph.publishers(self._status)), self._served)
        return self._silence.text

    def _served(self) -> List[str]:
        """The actions that other nodes serve."""
        return [topic[: -len(_STATUS)] for topic in self._graph.published() if topic.endswith(_STATUS)]
