"""A topic that nobody publishes is told, with what its name may have been meant to be."""

from __future__ import annotations

from difflib import SequenceMatcher

import pytest
from oracle_adapter import unpublished
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


def test_what_is_like_it_and_is_not_published_is_not_what_was_meant() -> None:
    clock = Clock()
    topic = Unpublished("/estops", clock)
    clock.now = PATIENCE
    published = {"/estop"}
    topic.look(lambda: False, lambda: ["/estop", "/estop_s", "/odd"], published.__contains__)
    assert topic.text == "nobody publishes /estops; did you mean /estop?"
    published.add("/estop_s")
    clock.now *= 2
    topic.look(lambda: False, lambda: ["/estop", "/estop_s", "/odd"], published.__contains__)
    assert topic.text == "nobody publishes /estops; did you mean /estop_s?"


def test_its_proxy_is_not_what_was_meant() -> None:
    clock = Clock()
    action = Unpublished("/go", clock, does="serves", proxy="/go_mon")
    clock.now = PATIENCE
    action.look(lambda: False, lambda: ["/go_mon", "/goo"])
    assert action.text == "nobody serves /go; did you mean /goo?"


def test_among_many_topics_few_names_are_compared_closely(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    compared: list[str] = []

    def counted(junk: None, name: str, other: str) -> SequenceMatcher[str]:
        compared.append(other)
        return SequenceMatcher(junk, name, other)

    monkeypatch.setattr(unpublished, "SequenceMatcher", counted)
    clock = Clock()
    topic = Unpublished("/uav1/camera/imge_7", clock)
    for _ in range(3):
        clock.now += PATIENCE
        topic.look(lambda: False, lambda: [f"/uav1/camera/image_{i}" for i in range(1000)])
    assert topic.text == "nobody publishes /uav1/camera/imge_7; did you mean /uav1/camera/image_7?"
    assert len(compared) < 10


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
