"""A link with several servers finds the one that has the session; no other gets its token."""

from __future__ import annotations

from contextlib import contextmanager
from typing import Iterator, List

import pytest
from oracle_adapter import Link, LinkError
from oracle_adapter.connection import addresses_of
from oracle_adapter.route import Route
from tests.adapters.common.conftest import Oracle
from tests.adapters.common.links import PATIENCE, QUICK


@pytest.fixture
def oracles() -> Iterator[List[Oracle]]:
    """Three servers, of which none listens yet."""
    made = [Oracle() for _ in range(3)]
    yield made
    for oracle in made:
        oracle.end()


@contextmanager
def linked(oracles: List[Oracle], errors: List[LinkError]) -> Iterator[Link]:
    urls = ",".join(oracle.url for oracle in oracles)
    link = Link(
        urls, "m", spec="spec", session="s1", token="t", timing=QUICK, on_error=errors.append
    )
    link.start()
    yield link
    link.close(timeout=0)  # nobody confirms that it detaches


def test_servers_are_tried_in_turn(oracles: List[Oracle]) -> None:
    oracles[2].start()
    with linked(oracles, []) as link:
        oracles[2].accept().attach()
        assert link.wait_attached(PATIENCE).session == "s1"


def test_a_server_that_names_another_one_is_believed_where_that_is_known(
    oracles: List[Oracle],
) -> None:
    first, second, third = oracles
    for oracle in oracles:
        oracle.start()
    with linked(oracles, []) as link:
        peer = first.accept()
        peer.recv()
        peer.send("error", code="moved", message="it is there", fatal=True, url=third.url)
        third.accept().attach()
        assert link.wait_attached(PATIENCE).session == "s1"
    assert second.requests.empty()
    assert third.requests.get(timeout=PATIENCE).headers["Authorization"] == "Bearer t"


def test_a_server_of_another_list_gets_no_token(oracles: List[Oracle]) -> None:
    first, second, stranger = oracles
    for oracle in oracles:
        oracle.start()
    errors: List[LinkError] = []
    with linked([first, second], errors) as link:
        for oracle in (first, second):
            peer = oracle.accept()
            peer.recv()
            peer.send("error", code="moved", message="it is there", fatal=True, url=stranger.url)
        first.accept().attach()
        link.wait_attached(PATIENCE)
    assert stranger.requests.empty()
    assert [error.code for error in errors] == ["moved"]
    assert "that is none of this monitor's servers" in str(errors[0])


def test_a_session_goes_on_at_another_server(oracles: List[Oracle]) -> None:
    first, second, _ = oracles
    first.start()
    with linked(oracles, []) as link:
        peer = first.accept()
        peer.attach()
        link.wait_attached(PATIENCE)
        link.send("/a", "topic", 1, {})
        peer.events(1)
        second.start()
        first.stop()
        other = second.accept()
        hello = other.recv()
        assert hello["session"] == "s1"
        other.send("error", code="moved", message="its server is gone", fatal=True)
        again = second.accept()
        again.attach(1)
        assert [event["seq"] for event in again.events(1)] == [1], "it was not acked"


def test_one_that_can_not_be_reached_is_not_tried_while_others_answer() -> None:
    now = 0.0
    route = Route(addresses_of("http://a,http://b:1,http://c:1", None, None), lambda: now)
    assert route.unreachable()
    tried = []
    for _ in range(4):
        tried.append(route.address.url[5])
        route.refused("http://a")
    assert {*tried} == {"b", "c"}
    now = 10.0
    route.refused("http://a")
    assert route.address.url[5] == "a"


def test_one_server_is_tried_again_and_again() -> None:
    route = Route(addresses_of("http://a", None, None), lambda: 0.0)
    assert [route.unreachable(), route.refused("http://a"), route.refused("http://b")] == [
        False
    ] * 3
    assert route.address.url.startswith("ws://a/")
