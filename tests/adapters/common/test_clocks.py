"""How far the streams of a monitor have come, and what of it is sent behind an ask."""

from __future__ import annotations

from dataclasses import dataclass
from typing import List, Optional

from oracle_adapter import Board, ClockStamp, Link
from oracle_adapter.clocks import CLOCK_WITHIN, Clocks, SilentClock, TornClock
from oracle_adapter.passing import Passing
from tests.adapters.common.boards import Clock
from tests.adapters.common.conftest import Oracle
from tests.adapters.common.links import PATIENCE
from tests.adapters.common.test_passing import STREAM, Screen


@dataclass
class Stream:
    name: str
    kind: str
    latency: Optional[int]


SCAN = Stream("/scan", "topic", 20)
CALLS = [Stream(name, kind, None) for name in ("/a", "/b") for kind in ("request", "response")]


def of(now: Optional[int], *streams: Stream) -> Clocks:
    clocks = Clocks(lambda: now)
    clocks.follow(streams)
    return clocks


def at(now: int, *streams: Stream) -> List[ClockStamp]:
    return [(stream.name, stream.kind, now) for stream in streams]


def test_what_is_stamped_here_is_exact_and_what_others_stamp_lags_by_its_latency() -> None:
    clocks = of(1000, SCAN, *CALLS)
    assert clocks.readings(900) == [*at(1000, *CALLS), ("/scan", "topic", 880)]
    assert clocks.readings(None) == at(1000, *CALLS), "others may have published what is not here"


def test_topics_have_clocks_where_nothing_is_stamped_here() -> None:
    assert of(1000, SCAN).readings(1000) == [("/scan", "topic", 980)]


def test_before_there_is_a_time_nothing_is_said() -> None:
    assert of(None, SCAN, *CALLS).readings(None) == []
    assert of(0, *CALLS).behind("/a", "request")() == []


def test_time_that_has_gone_back_is_told_of_each_stream_also_where_it_is_0() -> None:
    assert of(1000, SCAN, *CALLS).gone_back() == [("/scan", "topic", 980), *at(1000, *CALLS)]
    for none in (0, None):
        assert of(none, SCAN, *CALLS).gone_back() == at(0, SCAN, *CALLS)


def test_an_ask_is_followed_by_all_that_is_stamped_here() -> None:
    clocks = of(1000, SCAN, *CALLS)
    assert clocks.behind("/a", "request")() == at(1000, *CALLS)
    assert clocks.behind("/scan", "topic")() == at(1000, *CALLS)


def test_an_ask_of_the_only_stream_that_is_stamped_here_says_as_much_itself() -> None:
    only = Stream("/a", "topic", None)
    assert of(1000, SCAN, only).behind("/a", "topic")() == []


def test_the_clocks_go_behind_the_ask(oracle: Oracle, link: Link) -> None:
    peer = oracle.accept()
    peer.attach()
    link.wait_attached(PATIENCE)
    Passing(link, Board("uav1", Screen()), STREAM, of(1000, *CALLS)).ask(1000, {}, lambda _: None)
    assert peer.recv()["type"] == "event"
    stamps = peer.recv()["stamps"]
    assert [(s["stream"], s["kind"], s["stamp"]) for s in stamps] == at(1000, *CALLS)


def test_simulated_time_is_silent_where_it_is_not_told_within_some_seconds() -> None:
    clock, now = Clock(), [0]
    silent = SilentClock(lambda: now[0], clock)
    assert not silent.look()
    clock.now += CLOCK_WITHIN
    assert "/clock is silent" in silent.look()
    now[0] = 1
    assert not silent.look()


def test_simulated_time_that_stands_later_is_a_doubt_until_it_goes_on() -> None:
    clock, now = Clock(), [0]
    silent = SilentClock(lambda: now[0], clock)
    doubts, at = [], 103 * 10**9
    for now[0], passed in ((at, 0.0), (at, CLOCK_WITHIN), (at + 1, 0.0), (0, CLOCK_WITHIN)):
        clock.now += passed
        assert not silent.look()
        doubts.append(silent.doubt)
    told = "time stands at 103.000 s, so no deadline runs out: /clock is silent, or paused"
    assert doubts == ["", told, "", ""]
    clock.now += CLOCK_WITHIN
    assert "time stands at 0," in silent.look()
    assert not silent.doubt


def test_time_that_goes_back_is_torn_where_several_tell_it() -> None:
    torn, tellers = TornClock(), ["/world", "/player"]
    assert torn.look(tellers) == ""
    torn.goes_back()
    told = "time went back, which ends the session, and several publish /clock: /player, /world"
    assert [torn.look(tellers) for _ in range(2)] == [told, told]
    assert [torn.look(nodes) for nodes in (["/world"], tellers)] == ["", ""]


def test_time_that_one_node_sets_back_is_not_torn_once_another_comes() -> None:
    torn = TornClock()
    torn.goes_back()
    assert [torn.look(nodes) for nodes in (["/world"], ["/world", "/player"])] == ["", ""]
