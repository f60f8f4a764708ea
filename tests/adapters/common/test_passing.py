"""What becomes of messages that were asked about, whatever fails on the way."""

from __future__ import annotations

import logging
from typing import Any, Dict, List, Sequence

import pytest
from oracle_adapter import Answer, Board, Link, Stats, Status, forwarding
from oracle_adapter.clocks import Clocks
from oracle_adapter.forwarding import ForwardQueue
from oracle_adapter.passing import Passing
from tests.adapters.common.conftest import Oracle, Peer
from tests.adapters.common.links import PATIENCE, answer_of, ask

STREAM = {"name": "/a", "kind": "topic", "decide_within": 60 * 10**9, "on_unavailable": "deny"}


class Screen:
    """Keeps what is shown, or fails at everything."""

    def __init__(self) -> None:
        self.broken = False
        self.errors: List[str] = []
        self.verdicts: List[str] = []
        self.shown: List[Sequence[Status]] = []

    def verdict(self, outcome: str) -> None:
        self._check()
        self.verdicts.append(outcome)

    def error(self, text: str) -> None:
        self._check()
        self.errors.append(text)

    def info(self, text: str) -> None:
        self._check()

    def diagnostics(self, statuses: Sequence[Status]) -> None:
        self._check()
        self.shown.append(statuses)

    def _check(self) -> None:
        if self.broken:
            raise ZeroDivisionError("the screen is broken")


class Robot:
    """A topic of a link, with a forward that fails for the messages in `failing`."""

    def __init__(self, link: Link) -> None:
        self.screen = Screen()
        self.board = Board("uav1", self.screen)
        self.failing: List[str] = []
        self.forwarded: List[str] = []
        self.withheld: List[Any] = []
        self.queue = ForwardQueue(
            Passing(link, self.board, STREAM, Clocks(lambda: 1)),
            self._forward,
            lambda message, why: self.withheld.append((message, why)),
            size=len,
        )

    def take(self, *messages: str) -> None:
        for message in messages:
            self.queue.take(message, None, {})

    def _forward(self, message: str) -> bool:
        if message in self.failing:
            raise ZeroDivisionError(f"no way for {message}")
        self.forwarded.append(message)
        return True

    def counters(self) -> Dict[str, str]:
        self.board.tick(Stats())
        return dict(self.screen.shown[-1][0].values)


def decide(peer: Peer, *seqs: int, decision: str = "allow") -> None:
    for seq in seqs:
        peer.send("decision", seq=seq, decision=decision)


def handlings(peer: Peer, count: int) -> Dict[int, bool]:
    """What was done with so many asks, by their numbers."""
    found: List[Any] = []
    while len(found) < count:
        frame = peer.recv()
        found += frame["outcomes"] if frame["type"] == "outcomes" else [frame]
    return {outcome["seq"]: outcome["passed"] for outcome in found}


@pytest.fixture
def peer(oracle: Oracle, link: Link) -> Peer:
    peer = oracle.accept()
    peer.attach()
    link.wait_attached(PATIENCE)
    return peer


@pytest.fixture
def robot(link: Link) -> Robot:
    return Robot(link)


def test_a_forward_that_fails_holds_up_nothing_behind_it(peer: Peer, robot: Robot) -> None:
    robot.failing = ["first"]
    robot.take("first", "second", "third")
    peer.events(3)
    decide(peer, 3, 2, 1)  # nothing comes after the answer to the first
    assert handlings(peer, 3) == {1: False, 2: True, 3: True}
    assert robot.forwarded == ["second", "third"]


def test_what_does_not_pass_is_told_with_a_reason(peer: Peer, robot: Robot) -> None:
    robot.failing = ["second"]
    robot.take("first", "second", "third")
    peer.events(3)
    peer.send("decision", seq=1, decision="deny", denied_by=["slow", "near"])
    decide(peer, 2, 3)
    handlings(peer, 3)
    assert robot.forwarded == ["third"]
    assert robot.withheld == [
        ("first", "slow, near"),
        ("second", "it could not be passed on: ZeroDivisionError('no way for second')"),
    ]


def test_of_too_much_that_waits_the_oldest_does_not_pass(
    peer: Peer, robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(forwarding, "ROOM", 2 << 20)
    monkeypatch.setattr(forwarding, "FEW", 2)
    large = "x" * (1 << 20)
    robot.take("first", "second", large, large, "fifth")
    peer.events(5)
    decide(peer, 1, 2, 3, 4, 5)
    assert handlings(peer, 5) == {1: False, 2: False, 3: False, 4: True, 5: True}
    assert robot.forwarded == [large, "fifth"]
    (error,) = robot.screen.errors
    assert "more than 2 MiB waited for decisions" in error
    robot.take(large, large)  # what is settled takes no room
    peer.events(2)
    decide(peer, 6, 7)
    assert handlings(peer, 2) == {6: True, 7: True}


def test_failures_are_shown_once_a_stream_and_counted(peer: Peer, robot: Robot) -> None:
    robot.failing = ["first", "second"]
    robot.take("first", "second", "third")
    peer.events(3)
    decide(peer, 1, 2, 3)
    assert handlings(peer, 3) == {1: False, 2: False, 3: True}
    (error,) = robot.screen.errors
    assert "/a" in error
    assert "no way for first" in error
    assert robot.counters()["failed to pass on"] == "2"


@pytest.mark.parametrize("decision", ["allow", "deny"])
def test_a_screen_that_fails_holds_up_nothing(peer: Peer, robot: Robot, decision: str) -> None:
    robot.screen.broken = True
    robot.take("first", "second", "third")
    peer.events(3)
    decide(peer, 3, 2)
    decide(peer, 1, decision=decision)
    assert handlings(peer, 3) == {1: decision == "allow", 2: True, 3: True}


def test_a_cancel_passes_while_the_oracle_is_away_whatever_the_spec_says(link: Link) -> None:
    screen = Screen()
    stream = {**STREAM, "kind": "cancel", "name": "/dock"}
    passing = Passing(link, Board("uav1", screen), stream, Clocks(lambda: 1))
    given: List[str] = []
    away = Answer("unavailable", reason="no connection to the oracle")
    give: Any = given.append
    assert passing.settle(away, lambda what: give(what) is None, "stop", 3, "9f2c")[0]
    assert given == ["stop"]
    assert "passed a cancel of /dock, goal 9f2c: no connection" in screen.errors[0]
    denied = Answer("decision", "deny", ("no_stop",))
    assert passing.settle(denied, lambda _: True, "stop", 4, "9f2c") == (False, "no_stop")


@pytest.mark.parametrize(("policy", "passes"), [("deny", False), ("pass", True)])
def test_a_message_without_a_decision_passes_where_the_spec_says_so(
    link: Link, policy: str, passes: bool
) -> None:
    passing = Passing(
        link, Board("uav1", Screen()), {**STREAM, "on_unavailable": policy}, Clocks(lambda: 1)
    )
    given: List[str] = []
    give: Any = given.append
    away = Answer("timeout", reason="no answer in time")
    assert passing.settle(away, lambda what: give(what) is None, "go")[0] is passes
    assert given == ["go"] * passes


def test_a_decision_is_waited_for_as_long_as_the_spec_says() -> None:
    asked: List[float] = []

    class Asked:
        def ask_then(self, *_: Any, decide_within: float, **__: Any) -> None:
            asked.append(decide_within)

        def clock(self, behind: Any) -> None:
            pass

    link: Any = Asked()
    stream = {**STREAM, "decide_within": 250 * 10**6}
    Passing(link, Board("uav1", Screen()), stream, Clocks(lambda: 1)).ask(None, {}, lambda _: None)
    assert asked == [0.25], "in seconds"


class Broken(logging.Handler):
    """A log that fails."""

    def emit(self, record: logging.LogRecord) -> None:
        raise ZeroDivisionError


def test_a_log_that_fails_holds_up_nothing(peer: Peer, robot: Robot) -> None:
    handler = Broken()
    logging.getLogger("oracle_adapter").addHandler(handler)
    try:
        robot.screen.broken, robot.failing = True, ["first"]
        robot.take("first", "second", "third")
        peer.events(3)
        decide(peer, 3, 2, 1)
        assert handlings(peer, 3) == {1: False, 2: True, 3: True}
    finally:
        logging.getLogger("oracle_adapter").removeHandler(handler)


def test_a_screen_that_fails_does_not_end_the_adapter(
    peer: Peer, robot: Robot, caplog: pytest.LogCaptureFixture
) -> None:
    robot.screen.broken = True
    robot.board.on_state("attached", "s1")
    robot.board.on_verdicts({"worst": "false", "properties": {}})
    robot.board.on_violation({})
    robot.board.tick(Stats())
    assert caplog.text.count("ZeroDivisionError: ") == 1, "of one failure, however often"
    robot.screen.broken = False
    robot.board.on_state("disconnected", "gone")
    assert robot.screen.verdicts == ["unknown", "unknown"]


def test_answers_that_come_of_a_bad_frame_are_given_at_once(oracle: Oracle, link: Link) -> None:
    peer = oracle.accept()
    peer.attach()
    asked = ask(link, within=100 * PATIENCE)
    peer.events(1)
    peer.drop()
    oracle.accept().attach(upcoming=10, limits={"max_outcomes": "many"})  # the ask is lost by it
    assert answer_of(asked).reason == "the event was lost in a reconnect"
