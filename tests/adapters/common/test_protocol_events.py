"""The state of a link, frame by frame: events, acks, credit, and resuming."""

from __future__ import annotations

from oracle_adapter import Attached, LinkError
from oracle_adapter.notices import Answered
from tests.adapters.common.side import Side, answer_in


class TestFrames:
    def test_one_event_is_a_frame(self, side: Side) -> None:
        side.attach()
        side.protocol.send(17, '"stream":"/a","kind":"topic","data":1}', 3)
        assert side.frames() == [
            {"type": "event", "seq": 1, "stamp": 17, "lost": 3, "stream": "/a", "kind": "topic",
             "data": 1}
        ]  # fmt: skip

    def test_what_is_not_known_is_absent(self, side: Side) -> None:
        side.attach()
        side.send("x")
        assert side.frames() == [{"type": "event", "seq": 1, "data": "x"}]

    def test_more_are_batched(self, side: Side) -> None:
        side.attach()
        side.send("a", "b", "c")
        (frame,) = side.frames()
        assert frame["type"] == "events"
        assert [event["seq"] for event in frame["events"]] == [1, 2, 3]

    def test_a_batch_is_under_half_of_a_frame(self, side: Side) -> None:
        side.attach(limits={"max_frame": 4000})
        side.send(*["x" * 500] * 20)
        texts = list(iter(side.protocol.next_frame, None))
        assert 5 < len(texts) < 10
        assert max(map(len, texts)) <= 2000

    def test_a_batch_has_no_more_events_than_the_server_takes(self, side: Side) -> None:
        side.attach(limits={"max_batch": 2})
        side.send(1, 2, 3)
        assert [frame["type"] for frame in side.frames()] == ["events", "event"]

    def test_an_event_may_fill_a_frame(self, side: Side) -> None:
        side.attach(limits={"max_frame": 4000})
        side.send("x" * 3500)
        (text,) = iter(side.protocol.next_frame, None)
        assert 2000 < len(text) <= 4000

    def test_an_event_that_no_frame_holds_is_lost_and_told(self, side: Side) -> None:
        side.attach(limits={"max_frame": 4000})
        assert side.send("x" * 4000, "y") == [False, True]
        assert side.frames() == [{"type": "event", "seq": 1, "lost": 1, "data": "y"}]
        assert side.protocol.stats().lost == 1

    def test_one_that_became_too_large_is_lost_and_told(self, side: Side) -> None:
        side.send("x" * 4000)
        asked = side.queued("z" * 4000)
        side.send("y")
        notices = side.attach(limits={"max_frame": 4000})
        assert side.frames() == [{"type": "event", "seq": 1, "lost": 2, "data": "y"}]
        assert [type(notice) for notice in notices] == [Answered, Attached, LinkError]
        assert answer_in(notices[:1]).why == "unavailable"
        assert (notices[2].code, notices[2].fatal, asked.seq) == ("lost", False, None)


class TestAcks:
    def test_acked_events_are_let_go(self, side: Side) -> None:
        side.attach()
        side.send(1, 2, 3)
        side.frames()
        side.receive("ack", upto=2)
        stats = side.protocol.stats()
        assert (stats.queued, stats.sent, stats.acked) == (1, 3, 2)

    def test_they_make_room(self) -> None:
        side = Side(capacity=2)
        side.attach()
        assert side.send(1, 2, 3, 4) == [True, True, False, False]
        side.frames()
        assert side.send(5) == [False]
        side.receive("ack", upto=1)
        assert side.send(6) == [True]
        assert side.events() == [{"type": "event", "seq": 3, "lost": 3, "data": 6}]
        assert side.protocol.stats().lost == 3

    def test_losses_add_up(self) -> None:
        side = Side(capacity=1)
        side.attach()
        side.send(1)
        side.protocol.send(None, '"data":2}', 5)
        side.frames()
        side.receive("ack", upto=1)
        side.protocol.send(None, '"data":3}', 2)
        assert side.events()[0]["lost"] == 8

    def test_an_old_or_early_ack_does_no_harm(self, side: Side) -> None:
        side.attach()
        side.send(1, 2)
        side.frames()
        side.receive("ack", upto=2)
        side.receive("ack", upto=1)
        side.receive("ack", upto=9)
        side.send(3)
        assert side.numbers() == [3]


class TestCredit:
    def test_without_it_events_wait_and_clocks_before_them_go(self, side: Side) -> None:
        side.attach(limits={"credit": 1})
        side.send("a")
        side.protocol.clock([("/a", "topic", 5)])
        side.send("b", "c")
        side.protocol.clock([("/a", "topic", 6)])
        assert [frame["type"] for frame in side.frames()] == ["event", "clock"]
        side.receive("credit", events=1)
        assert side.numbers() == [2]
        side.receive("credit", events=10)
        assert [frame["type"] for frame in side.frames()] == ["event", "clock"]

    def test_an_ask_goes_with_all_that_stands_before_it(self, side: Side) -> None:
        side.attach(limits={"credit": 0})
        side.send("a")
        side.queued("b")
        side.send("c")
        assert side.numbers() == [1, 2]
        side.receive("credit", events=2)
        assert side.numbers() == []
        side.receive("credit", events=1)
        assert side.numbers() == [3]

    def test_it_is_not_asked_for_where_events_would_be_lost(self) -> None:
        side = Side(capacity=8)
        side.attach(limits={"credit": 0})
        side.send(*range(6))
        assert side.numbers() == []
        side.send(6)
        assert side.numbers() == [1, 2, 3, 4, 5, 6, 7]

    def test_it_begins_anew_with_each_connection(self, side: Side) -> None:
        side.attach(limits={"credit": 1})
        side.send("a", "b")
        assert side.numbers() == [1]
        side.reconnect(1, limits={"credit": 1})
        assert side.numbers() == [1]
        side.receive("credit", events=1)
        assert side.numbers() == [2]

    def test_a_server_that_says_nothing_of_it_has_room(self, side: Side) -> None:
        side.attach()
        side.receive("credit", events=1)
        side.send("a", "b", "c")
        assert side.numbers() == [1, 2, 3]

    def test_detaching_waits_for_none(self, side: Side) -> None:
        side.attach(limits={"credit": 0})
        side.send("a")
        side.protocol.detach()
        assert [frame["type"] for frame in side.frames()] == ["event", "detach"]
        side.reconnect(1, limits={"credit": 0})
        assert [frame["type"] for frame in side.frames()] == ["event", "detach"]


class TestResuming:
    def test_the_rest_is_sent_again(self, side: Side) -> None:
        side.attach()
        side.send(1, 2, 3)
        side.frames()
        side.send(4)
        side.reconnect(upcoming=2)
        assert side.numbers() == [2, 3, 4]
        stats = side.protocol.stats()
        assert (stats.sent, stats.resent, stats.reconnects, stats.lost) == (4, 2, 1, 0)

    def test_what_the_server_has_is_kept_until_acked(self, side: Side) -> None:
        side.attach()
        side.send(1, 2)
        side.frames()
        side.reconnect(upcoming=3)
        assert side.numbers() == []
        side.reconnect(upcoming=1)  # it went down before it could commit
        assert side.numbers() == [1, 2]

    def test_nothing_but_the_new_goes_on_the_new_connection(self, side: Side) -> None:
        side.attach()
        side.send(1)
        side.protocol.disconnected()
        assert side.frames() == []

    def test_acked_events_that_the_server_forgot_are_lost(self, side: Side) -> None:
        side.attach()
        side.send(1, 2, 3, 4)
        side.frames()
        side.receive("ack", upto=3)
        _, error = side.reconnect(upcoming=1)
        assert isinstance(error, LinkError)
        assert (error.code, error.fatal) == ("lost", False)
        assert side.numbers() == [4]  # the gap tells the server
        assert side.protocol.stats().lost == 3

    def test_so_are_they_where_nothing_is_queued(self, side: Side) -> None:
        side.attach()
        side.send(1, 2)
        side.frames()
        side.receive("ack", upto=2)
        side.reconnect(upcoming=1)
        assert side.protocol.stats().lost == 2

    def test_numbers_used_by_another_are_left_to_it(self, side: Side) -> None:
        side.attach()
        side.send(1, 2)
        asked = side.queued()
        side.frames()
        side.send("new")
        notices = side.reconnect(upcoming=20)
        assert [type(notice) for notice in notices] == [Answered, Attached, LinkError]
        assert answer_in(notices[:1]).why == "unavailable"
        assert side.events() == [{"type": "event", "seq": 20, "lost": 3, "data": "new"}]
        assert side.protocol.stats().lost == 3
        side.receive("decision", seq=asked.seq, decision="allow")
        assert not asked.waiting

    def test_so_are_they_where_it_has_used_fewer(self, side: Side) -> None:
        side.attach()
        side.send(1, 2)
        asked = side.queued()
        side.send(4)
        side.frames()
        side.receive("ack", upto=1)
        side.reconnect(upcoming=3, first=3)
        side.receive("ack", upto=2)  # of the other's event
        assert [(event["seq"], event.get("lost"), event["data"]) for event in side.events()] == [
            (3, 1, "ask"),
            (4, None, 4),
        ]
        assert answer_in(side.receive("decision", seq=3, decision="allow")).event is asked
        side.receive("ack", upto=4)
        side.reconnect(upcoming=5, first=3)
        assert (side.numbers(), side.protocol.stats().lost) == ([], 1)

    def test_handlings_of_such_events_are_dropped(self, side: Side) -> None:
        side.attach()
        asked = side.queued()
        side.frames()
        answer = answer_in(side.receive("decision", seq=1, decision="allow"))
        side.protocol.handled(answer, True, "decision")
        side.frames()
        side.reconnect(upcoming=20)
        assert asked.seq == 1
        assert side.frames() == []

    def test_a_jump_with_nothing_in_flight_loses_nothing(self, side: Side) -> None:
        side.attach()
        side.send(1)
        side.frames()
        side.receive("ack", upto=1)
        side.reconnect(upcoming=9)
        side.send(2)
        assert side.numbers() == [9]
        assert side.protocol.stats().lost == 0
