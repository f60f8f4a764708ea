"""A topic that nobody publishes is told, with what its name may have been meant to be."""

from __future__ import annotations

import pytest
from oracle_adapter.unpublished import PATIENCE, Unpublished
from tests.adapters.common.boards import Clock


def looked(name: str, *others: str) -> str:
    """What is said of a topic that nobody has published for long."""
    clock = Clock()
    topic = Unpublished(name, clock)
    clock.now = PATIENCE
    topic.look(lambda: False, lambda: others)
    return topic.text


@pytest.mark.parametrize(
    ("name", "others", "meant"),
    [
        ("/estops", ["/scan", "/estop", "/e"], "/estop"),
        ("/Dock", ["/dock", "/docks"], "/dock"),
        ("/scan", ["/scam", "/uav1/scan"], "/uav1/scan"),
        ("/uav1/scan", ["/uav2/scan", "/scan"], "/scan"),
    ],
)
def test_what_it_may_have_been_meant_to_be(name: str, others: list[str], meant: str) -> None:
    assert looked(name, *others) == f"nobody publishes {name}; did you mean {meant}?"


def test_what_is_like_nothing_is_told_alone() -> None:
    assert looked("/estop", "/battery_state") == looked("/estop") == "nobody publishes /estop"


def test_one_that_the_graph_knows_and_that_can_not_be_reached_is_published() -> None:
    assert looked("/estop", "/estop", "/estops") == ""


def test_it_is_told_after_a_while_and_never_again_once_somebody_has_published_it() -> None:
    clock = Clock()
    topic = Unpublished("/a", clock)
    topic.look(lambda: False, list)
    assert topic.text == ""
    clock.now = PATIENCE
    topic.look(lambda: False, list)
    assert topic.text == "nobody publishes /a"
    topic.look(lambda: True, list)
    assert topic.text == ""
    clock.now *= 3
    topic.look(lambda: False, list)
    assert topic.text == ""
