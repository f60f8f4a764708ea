"""Which nodes of the robot's graph are monitors, by the topics that each monitor has."""

from __future__ import annotations

import re
from typing import Dict, Iterable, List, Mapping, Set

from oracle_adapter.names import PROXY

OWN = ("/diagnostics", "/rosout")
"""Where monitors tell of violations: to observe that would be to violate again, for ever."""
ERRORS, VERDICT = "monitor_error", "monitor_verdict"
"""The topics that each monitor has in its namespace: who publishes both is a monitor."""
NAME = "the monitor's name"
"""What the board calls it, which another monitor may have too."""


def refuse_own(name: str, heard: str, own: Iterable[str]) -> None:
    """Raise ValueError where a filtered topic is heard where the adapter itself speaks.

    `heard`, `own`: the names on the graph of what it hears, and of `OWN`.
    """
    if heard in own:
        raise ValueError(
            f"{name} can't be filtered by intercept: subscriber: the adapter itself speaks there, "
            "and would judge each of its own words; write intercept: publisher, or action: log"
        )


def namesakes_text(others: Iterable[str], verdict: str) -> str:
    """What to tell of those who publish a monitor's topic of verdicts too; empty for nobody."""
    nodes = " and ".join(others)
    if not nodes:
        return ""
    what = f"{nodes} publishes {verdict} too, where one can't tell whose verdict it is"
    return f"{what}: give each monitor a name of its own, by --monitor"


def errors_among(topics: Iterable[str]) -> List[str]:
    """The topics of monitors' errors: those beside which a verdict is."""
    there = set(topics)
    found = (topic for topic in there if topic.endswith(f"/{ERRORS}"))
    return [topic for topic in found if topic[: -len(ERRORS)] + VERDICT in there]


def doubtful(publishers: Mapping[str, Iterable[str]]) -> Dict[str, str]:
    """The nodes that are not called as the monitors whose errors they publish, each with a topic.

    A bridge or the player of a bag may say much that is the robot's. `publishers`: the nodes by
    the errors' topics.
    """
    return {
        node: topic
        for topic, nodes in publishers.items()
        for node in nodes
        if not _plain(node).endswith(_called(topic))
    }


def doubt_text(doubtful_nodes: Mapping[str, str], speakers: Iterable[str]) -> str:
    """What to tell of those among the nodes that say something; empty where there are none."""
    said = "what it says here is left out"
    return "; ".join(
        f"{node} is taken for a monitor, as it publishes {doubtful_nodes[node]}: {said}"
        for node in sorted(doubtful_nodes.keys() & set(speakers))
    )


def other_origins(heard: str, given: str) -> Set[str]:
    """Where else than from what is `given` another monitor may have what it gives as `heard`.

    Of one that listens there it is not sure that it gives back what this one has `given`.
    """
    plain = heard[: -len(PROXY)] if heard.endswith(PROXY) else heard
    return {heard + PROXY, plain} - {heard, given}


def circle_text(who: Iterable[str], heard: str, given: str) -> str:
    """What to tell of monitors that give back what is given; empty where there are none."""
    names = " and ".join(sorted(who))
    if not names:
        return ""
    return (
        f"{names} is a monitor that hears {given} and gives {heard}: what it gives is not taken, "
        "as it would come round for ever; judge it by one spec, or give one another name by --remap"
    )


def _called(errors: str) -> str:
    """How the node's name ends of the monitor that has a topic of errors."""
    return _plain(errors[: -len(ERRORS)].strip("/"))


def _plain(name: str) -> str:
    """A name in which topics and nodes of a monitor are alike: each has a `_` where it must."""
    return re.sub("[/_]+", "_", name)
