"""The state of a link, frame by frame: going on in another session."""

from __future__ import annotations

import json
from typing import Any

import pytest
from tests.adapters.common.side import Side, answer_in


def told(clock: Any) -> int:
    """The time of a clock's one stream."""
    [stamp] = clock["stamps"]
    return int(stamp["stamp"])


class TestGoingOnInAnotherSession:
    def test_what_comes_after_the_clock_went_back_waits_for_the_next_session(
        self, side: Side
    ) -> None:
        side.attach()
        side.send("old")
        side.protocol.renew([("/a", "topic", 5)])
        side.send("new")
        side.protocol.clock([("/a", "topic", 6)])
        old, *clocks = side.frames()
        assert (old["data"], *map(told, clocks)) == ("old", 6, 5)
        side.receive("error", code="session_ended", message="over", fatal=True, session="s1.run2")
        assert side.frames() == []
        side.protocol.disconnected()
        assert json.loads(side.protocol.hello())["session"] == "s1.run2"
        side.attach(session="s1.run2")
        clock, new = side.frames()
        assert (clock["stamps"][0]["stamp"], new["seq"], new["data"]) == (5, 1, "new")

    def test_the_clock_is_told_again_after_a_reconnect(self, side: Side) -> None:
        side.attach()
        side.send("old")
        side.protocol.renew([("/a", "topic", 5)])
        side.send("new")
        assert [frame["type"] for frame in side.frames()] == ["event", "clock", "clock"]
        side.reconnect(2)
        assert [told(frame) for frame in side.frames()] == [6, 5], (
            "it goes back for who knows nothing, too"
        )

    def test_who_has_told_no_time_goes_back_all_the_same(self, side: Side) -> None:
        side.protocol.renew([("/a", "topic", 5)])
        side.send("new")
        side.attach()
        assert [told(frame) for frame in side.frames()] == [6, 5]
        side.receive("error", code="session_ended", message="over", fatal=True, session="s2")
        side.reconnect(1, session="s2")
        clock, new = side.frames()
        assert (told(clock), new["seq"], new["data"]) == (5, 1, "new")

    def test_nothing_is_held_back_where_no_clock_is_known_that_goes_back(self, side: Side) -> None:
        side.attach()
        side.protocol.clock([("/a", "topic", 100)])
        side.protocol.renew([])
        side.send("new")
        side.protocol.clock([("/a", "topic", 1)])
        clock, new, back = side.frames()
        assert (told(clock), new["data"], told(back)) == (100, "new", 1)

    @pytest.mark.parametrize("attached", [False, True])
    def test_who_hears_of_it_after_others_is_in_the_next_session_already(
        self, attached: bool
    ) -> None:
        side = Side(session="s1", clock="sim")
        side.attach()
        side.protocol.clock([("/a", "topic", 100)])
        side.send("judged")
        side.frames()
        side.receive("error", code="session_ended", message="over", fatal=True, session="s2")
        side.protocol.disconnected()
        if attached:
            side.attach(session="s2")
        stale = side.queued("of the time before")
        side.protocol.clock([("/a", "topic", 101)])
        side.protocol.renew([("/a", "topic", 5)])
        first, *lost = side.protocol.take_notices()
        answered = answer_in([first])
        assert (answered.event, answered.why) == (stale, "unavailable")
        assert str(*lost) == "lost: 1 events may not be in the session that has ended"
        side.send("new")
        if not attached:
            side.attach(session="s2")
        clock, new = side.frames()
        assert (told(clock), new["seq"], new["data"]) == (5, 1, "new")
        side.protocol.clock([("/a", "topic", 7)])
        side.send("later")
        clock, later = side.frames()
        assert (told(clock), later["seq"]) == (7, 2)
        side.protocol.renew([("/a", "topic", 1)])
        assert [told(frame) for frame in side.frames()] == [2, 1], "that ends this session"

    def test_who_has_told_its_clock_in_the_session_after_others_ends_that_one(self) -> None:
        side = Side(session="s1", clock="sim")
        side.attach()
        side.receive("error", code="session_ended", message="over", fatal=True, session="s2")
        side.reconnect(1, session="s2")
        side.protocol.clock([("/a", "topic", 6)])
        assert [told(clock) for clock in side.frames()] == [6]
        side.send("of this session")
        side.protocol.renew([("/a", "topic", 5)])
        event, *clocks = side.frames()
        assert (event["data"], *map(told, clocks)) == ("of this session", 6, 5)
        assert side.protocol.stats().lost == 0

    def test_what_was_done_meanwhile_is_told_in_the_next_session(self, side: Side) -> None:
        side.attach()
        side.protocol.renew([("/a", "topic", 5)])
        asked = side.queued("new")
        side.frames()
        side.protocol.expire(asked)
        answer = answer_in(side.protocol.take_notices())
        side.protocol.handled(answer, True, answer.why)
        assert side.frames() == []
        side.receive("error", code="session_ended", message="over", fatal=True, session="s1.run2")
        side.reconnect(1, session="s1.run2")
        clock, event, outcome = side.frames()
        assert (clock["type"], event["data"]) == ("clock", "new")
        assert outcome == {"type": "outcome", "seq": 1, "passed": True, "why": "timeout"}

    def test_what_was_not_taken_is_lost_and_its_asks_are_answered(self, side: Side) -> None:
        side.attach()
        side.send("taken")
        asked = side.queued("open")
        side.frames()
        side.receive("ack", upto=1)
        side.send("unsent")
        notices = side.receive("error", code="session_ended", message="over", fatal=True)
        error, answered, lost = notices
        assert (error.code, error.fatal) == ("session_ended", False)
        assert str(lost) == "lost: 2 events may not be in the session that has ended"
        assert (answered.event, answered.answer.why) == (asked, "unavailable")
        assert side.protocol.stats().lost == 2
        side.protocol.disconnected()
        assert "session" not in json.loads(side.protocol.hello())

    def test_a_session_of_ones_own_that_was_closed_meanwhile_is_made_anew(self, side: Side) -> None:
        side.attach()
        side.send("kept", "in flight")
        asked = side.queued("asked")
        side.frames()
        side.receive("ack", upto=1)
        side.protocol.disconnected()
        side.send("waiting")
        (error,) = side.receive("error", code="session_closed", message="gone", fatal=True)
        assert not error.fatal
        hello = json.loads(side.protocol.hello())
        assert ("session" in hello, hello["spec"]) == (False, "battery")
        side.reconnect(1, session="s2")
        assert [(event["seq"], event["data"]) for event in side.events()] == [
            (1, "in flight"), (2, "asked"), (3, "waiting"),
        ]  # fmt: skip
        answered = answer_in(side.receive("decision", seq=2, decision="allow"))
        assert answered.event is asked
        side.protocol.handled(answered, True, "decision")
        side.receive("ack", upto=3)
        assert side.frames() == [{"type": "outcome", "seq": 2, "passed": True, "why": "decision"}]
        stats = side.protocol.stats()
        assert (stats.lost, stats.queued) == (0, 0)

    def test_what_was_done_in_the_closed_session_is_not_told_in_the_new_one(
        self, side: Side
    ) -> None:
        side.attach()
        side.ask()
        side.frames()
        answer = answer_in(side.receive("decision", seq=1, decision="allow"))
        side.receive("ack", upto=1)
        side.protocol.handled(answer, True, "decision")
        side.frames()
        side.protocol.disconnected()
        side.receive("error", code="session_closed", message="gone", fatal=True)
        side.reconnect(1, session="s2")
        assert side.frames() == []

    def test_a_session_that_somebody_closes_is_over(self, side: Side) -> None:
        side.attach()
        (error,) = side.receive("error", code="session_closed", message="by hand", fatal=True)
        assert error.fatal

    def test_a_named_session_that_was_closed_is_over(self) -> None:
        side = Side(session="flight1")
        side.attach(session="flight1")
        side.protocol.disconnected()
        (error,) = side.receive("error", code="session_closed", message="gone", fatal=True)
        assert error.fatal

    def test_an_ask_after_it_waits_too(self, side: Side) -> None:
        side.attach()
        side.protocol.renew([("/a", "topic", 5)])
        asked = side.queued("new")
        side.receive("error", code="session_ended", message="over", fatal=True, session="s2")
        side.reconnect(1, session="s2")
        clock, ask = side.frames()
        assert (clock["type"], ask["seq"]) == ("clock", 1)
        assert answer_in(side.receive("decision", seq=1, decision="allow")).event is asked

    def test_what_waits_for_a_session_that_was_closed_before_goes_to_the_next(self) -> None:
        side = Side(session="s1")
        side.attach()
        side.send("kept", "in flight")
        side.frames()
        side.receive("ack", upto=1)
        side.protocol.disconnected()
        asked = side.queued("asked")
        side.protocol.hello()
        (error,) = side.receive(
            "error", code="session_ended", message="idle", fatal=True, session="s1.run2"
        )
        assert not error.fatal
        side.protocol.disconnected()
        assert json.loads(side.protocol.hello())["session"] == "s1.run2"
        side.attach(session="s1.run2")
        assert [(event["seq"], event["data"]) for event in side.events()] == [
            (1, "in flight"), (2, "asked"),
        ]  # fmt: skip
        decided = side.receive("decision", seq=2, decision="allow")
        assert answer_in(decided).event is asked
        assert side.protocol.stats().lost == 0

    def test_what_was_queued_before_a_simulation_began_anew_stays_behind(self) -> None:
        side = Side(session="s1", clock="sim")
        side.send("old")
        side.protocol.hello()
        side.receive("error", code="session_ended", message="over", fatal=True, session="s1.run2")
        side.reconnect(1, session="s1.run2")
        assert side.events() == []
