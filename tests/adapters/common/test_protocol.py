"""The state of a link, frame by frame."""

from __future__ import annotations

import json
from typing import Any, Dict, List, Optional, Union

import pytest
from oracle_adapter import Answer, Attached, LinkError
from oracle_adapter.outbox import Queued
from oracle_adapter.protocol import Answered, Hello, Protocol, Violation

Frame = Dict[str, Any]


class Side:
    """A protocol, and short words for what both sides do to it."""

    def __init__(self, capacity: int = 100, **hello: Any) -> None:
        self.protocol = Protocol(Hello("uav1", "i1", **hello), capacity)

    def attach(self, upcoming: int = 1, **fields: Any) -> List[Any]:
        answer = {
            "monitor": "uav1",
            "session": "s1",
            "spec": "battery",
            "spec_digest": "d1",
            "streams": [{"name": "/a", "kind": "topic"}],
            "next": upcoming,
            "limits": {},
        }
        return self.receive("attached", **{**answer, **fields})

    def receive(self, type_: str, **fields: Any) -> List[Any]:
        self.protocol.receive(json.dumps({"type": type_, **fields}))
        return self.protocol.take_notices()

    def send(self, *values: Any) -> List[bool]:
        return [self.protocol.send(None, f'"data":{json.dumps(value)}}}') for value in values]

    def ask(self, value: Any = "ask") -> Union[Queued, Answer]:
        return self.protocol.ask(None, f'"ask":true,"data":{json.dumps(value)}}}')

    def queued(self, value: Any = "ask") -> Queued:
        event = self.ask(value)
        assert isinstance(event, Queued)
        return event

    def frames(self) -> List[Frame]:
        return [json.loads(text) for text in iter(self.protocol.next_frame, None)]

    def events(self) -> List[Frame]:
        found: List[Frame] = []
        for frame in self.frames():
            found += frame["events"] if frame["type"] == "events" else [frame]
        return found

    def numbers(self) -> List[int]:
        return [event["seq"] for event in self.events()]

    def reconnect(self, upcoming: int, **fields: Any) -> List[Any]:
        self.protocol.disconnected()
        return self.attach(upcoming, **fields)


@pytest.fixture
def side() -> Side:
    return Side()


def answer_in(notices: List[Any]) -> Answer:
    (notice,) = notices
    assert isinstance(notice, Answered)
    return notice.answer


class TestAttaching:
    def test_it_says_only_what_was_given(self) -> None:
        hello = json.loads(Side(streams=("/a", "/b"), clock="sim").protocol.hello())
        assert hello == {
            "type": "attach",
            "monitor": "uav1",
            "instance": "i1",
            "streams": ["/a", "/b"],
            "clock": "sim",
        }

    def test_the_second_time_it_names_session_and_spec(self, side: Side) -> None:
        side.attach(session="anonymous-7", spec="battery")
        hello = json.loads(side.protocol.hello())
        assert (hello["session"], hello["spec"]) == ("anonymous-7", "battery")

    def test_the_spec_asked_for_stays(self) -> None:
        side = Side(spec="mine")
        side.attach(spec=None)
        assert json.loads(side.protocol.hello())["spec"] == "mine"

    def test_what_the_server_says_is_passed_on(self, side: Side) -> None:
        stream = {"name": "/SetLED", "kind": "request", "proxy": "/SetLED_mon", "later": [1]}
        (attached,) = side.attach(streams=[stream], limits={"max_frame": 5000})
        assert attached == Attached("uav1", "s1", "battery", "d1", (stream,), {"max_frame": 5000})
        assert side.protocol.attached is attached

    def test_nothing_is_written_before_it(self, side: Side) -> None:
        side.send(1)
        side.protocol.clock([("/a", "topic", 5)])
        assert side.frames() == []

    def test_numbers_go_on_where_the_server_stands(self, side: Side) -> None:
        side.send("a", "b")
        side.attach(upcoming=41)
        side.send("c")
        assert [(event["seq"], event["data"]) for event in side.events()] == [
            (41, "a"), (42, "b"), (43, "c"),
        ]  # fmt: skip


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


class TestGoingOnInAnotherSession:
    def test_what_comes_after_the_clock_went_back_waits_for_the_next_session(
        self, side: Side
    ) -> None:
        side.attach()
        side.send("old")
        side.protocol.renew([("/a", "topic", 5)])
        side.send("new")
        side.protocol.clock([("/a", "topic", 6)])
        old, clock = side.frames()
        assert (old["data"], clock["stamps"][0]["stamp"]) == ("old", 5)
        side.receive("error", code="session_ended", message="over", fatal=True, session="s1.run2")
        assert side.frames() == []
        side.protocol.disconnected()
        assert json.loads(side.protocol.hello())["session"] == "s1.run2"
        side.attach(session="s1.run2")
        assert [(event["seq"], event["data"]) for event in side.events()] == [(1, "new")]

    def test_the_clock_is_told_again_after_a_reconnect(self, side: Side) -> None:
        side.attach()
        side.send("old")
        side.protocol.renew([("/a", "topic", 5)])
        side.send("new")
        assert [frame["type"] for frame in side.frames()] == ["event", "clock"]
        side.reconnect(2)
        assert [frame["type"] for frame in side.frames()] == ["clock"]

    def test_what_was_not_taken_is_lost_and_its_asks_are_answered(self, side: Side) -> None:
        side.attach()
        side.send("taken")
        asked = side.queued("open")
        side.frames()
        side.receive("ack", upto=1)
        side.send("unsent")
        error, answered = side.receive("error", code="session_ended", message="over", fatal=True)
        assert (error.code, error.fatal) == ("session_ended", False)
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
        side.protocol.outcome(answered, True, "decision")
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
        side.protocol.outcome(answer, True, "decision")
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
        assert side.numbers() == [1]
        assert answer_in(side.receive("decision", seq=1, decision="allow")).event is asked


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

    def test_outcomes_of_such_events_are_dropped(self, side: Side) -> None:
        side.attach()
        asked = side.queued()
        side.frames()
        answer = answer_in(side.receive("decision", seq=1, decision="allow"))
        side.protocol.outcome(answer, True, "decision")
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


class TestAsks:
    def test_a_decision_answers(self, side: Side) -> None:
        side.attach()
        asked = side.queued()
        assert side.events()[0]["ask"] is True
        answer = answer_in(
            side.receive(
                "decision", seq=1, decision="deny", denied_by=["p"], verdicts={"p": "false"}
            )
        )
        assert answer == Answer("decision", "deny", ("p",), {"p": "false"})
        assert (answer.seq, answer.event) == (1, asked)

    def test_a_decision_after_the_time_is_ignored(self, side: Side) -> None:
        side.attach()
        asked = side.queued()
        side.frames()
        side.protocol.expire(asked)
        assert answer_in(side.protocol.take_notices()).why == "timeout"
        assert side.receive("decision", seq=1, decision="allow") == []
        side.protocol.expire(asked)
        assert side.protocol.take_notices() == []
        stats = side.protocol.stats()
        assert (stats.timeouts, stats.unavailable) == (1, 0)

    @pytest.mark.parametrize("sent", [False, True])
    def test_without_a_connection_it_is_unavailable_and_sent_all_the_same(
        self, side: Side, sent: bool
    ) -> None:
        if sent:
            side.attach()
        asked = side.queued()
        side.frames()
        side.protocol.disconnected()
        side.protocol.expire(asked)
        answer = answer_in(side.protocol.take_notices())
        assert (answer.why, answer.decision) == ("unavailable", None)
        side.protocol.outcome(answer, False, answer.why)
        side.attach(1)
        event, outcome = side.frames()
        assert (event["seq"], event["ask"]) == (1, True)
        assert outcome == {"type": "outcome", "seq": 1, "passed": False, "why": "unavailable"}
        assert side.receive("decision", seq=1, decision="allow") == []
        assert side.protocol.stats().unavailable == 1

    def test_one_the_server_has_is_asked_again(self, side: Side) -> None:
        side.attach()
        side.send("a")
        side.queued()
        side.send("b")
        side.frames()
        side.reconnect(upcoming=4)
        side.receive("ack", upto=3)  # may overtake the question
        assert side.numbers() == [2, 3]
        assert answer_in(side.receive("decision", seq=2, decision="allow")).decision == "allow"
        assert side.protocol.stats().queued == 0

    def test_one_already_answered_is_not(self, side: Side) -> None:
        side.attach()
        side.queued()
        side.frames()
        side.receive("decision", seq=1, decision="allow")
        side.reconnect(upcoming=2)
        assert side.frames() == []

    def test_a_full_queue_answers_at_once(self) -> None:
        side = Side(capacity=1)
        side.send(1)
        answer = side.ask()
        assert isinstance(answer, Answer)
        assert (answer.why, answer.reason, answer.seq) == ("unavailable", "the queue is full", None)
        side.protocol.outcome(answer, False, answer.why)  # there is nothing to report on
        side.attach()
        assert [frame["type"] for frame in side.frames()] == ["event"]

    def test_a_refused_event_has_no_decision(self, side: Side) -> None:
        side.attach()
        side.queued()
        side.frames()
        error, answered = side.receive("error", code="bad_stamp", message="in the future", seq=1)
        assert isinstance(error, LinkError)
        assert (error.code, error.seq, error.fatal) == ("bad_stamp", 1, False)
        assert answer_in([answered]).reason == "bad_stamp: in the future"
        side.reconnect(upcoming=2)
        assert side.frames() == []
        stats = side.protocol.stats()
        assert (stats.refused, stats.unavailable) == (1, 1)

    def test_an_unknown_decision_is_no_permission(self, side: Side) -> None:
        side.attach()
        side.queued()
        side.frames()
        answer = answer_in(side.receive("decision", seq=1, decision="perhaps"))
        assert (answer.why, answer.decision) == ("unavailable", None)

    def test_the_end_answers_all(self, side: Side) -> None:
        side.attach()
        first, second = side.queued(), side.queued()
        side.frames()
        third = side.queued()
        side.protocol.end(LinkError("replaced", "by another", fatal=True))
        notices = side.protocol.take_notices()
        answered = [notice for notice in notices if isinstance(notice, Answered)]
        assert [notice.event for notice in answered] == [first, second, third]
        assert {notice.answer.why for notice in answered} == {"unavailable"}
        late = side.ask()
        assert isinstance(late, Answer)
        assert late.reason == "replaced: by another"
        assert side.send(1) == [False]
        assert side.protocol.stats().lost == 3
        assert side.frames() == []


class TestOutcomes:
    def answered(self, side: Side) -> Answer:
        asked = side.queued()
        side.frames()
        return answer_in(side.receive("decision", seq=asked.seq, decision="allow"))

    def test_one_follows_its_event(self, side: Side) -> None:
        side.attach()
        answer = self.answered(side)
        side.protocol.outcome(answer, True, "decision")
        assert side.frames() == [{"type": "outcome", "seq": 1, "passed": True, "why": "decision"}]

    def test_one_that_may_not_have_arrived_is_sent_again(self, side: Side) -> None:
        side.attach()
        side.protocol.outcome(self.answered(side), True, "decision")
        side.frames()
        side.receive("ack", upto=1)
        side.reconnect(upcoming=2)
        assert [frame["type"] for frame in side.frames()] == ["outcome"]

    def test_one_that_has_arrived_is_not(self, side: Side) -> None:
        side.attach()
        side.protocol.outcome(self.answered(side), True, "decision")
        side.frames()
        side.send("later")
        side.frames()
        side.receive("ack", upto=2)
        side.reconnect(upcoming=3)
        assert side.frames() == []


class TestClocks:
    def clocks(self, side: Side) -> List[Any]:
        return [
            {item["stream"]: item["stamp"] for item in frame["stamps"]}
            if frame["type"] == "clock"
            else [event["data"] for event in frame.get("events", [frame])]
            for frame in side.frames()
        ]

    def clock(self, side: Side, **stamps: int) -> None:
        side.protocol.clock([(stream, "topic", stamp) for stream, stamp in stamps.items()])

    def test_one_keeps_its_place_among_events(self, side: Side) -> None:
        side.attach()
        side.send(1, 2)
        self.clock(side, a=2)
        side.send(3)
        assert self.clocks(side) == [[1, 2], {"a": 2}, [3]]

    def test_one_alone_is_sent_at_once(self, side: Side) -> None:
        side.attach()
        side.protocol.clock([("/a", "request", 5), ("/a", "response", 6)])
        assert side.frames() == [
            {
                "type": "clock",
                "stamps": [
                    {"stream": "/a", "kind": "request", "stamp": 5},
                    {"stream": "/a", "kind": "response", "stamp": 6},
                ],
            }
        ]
        side.protocol.clock([])
        assert side.frames() == []

    def test_the_newer_replaces_the_older_but_for_the_first(self, side: Side) -> None:
        side.attach()
        side.send(1)
        for stamp in range(1, 10):
            self.clock(side, a=stamp, **({"b": stamp} if stamp < 5 else {}))
            side.send(stamp + 1)
        assert self.clocks(side) == [
            [1], {"a": 1, "b": 1}, [*range(2, 10)], {"a": 9, "b": 4}, [10],
        ]  # fmt: skip

    def test_it_waits_for_events_sent_again(self, side: Side) -> None:
        side.attach()
        side.send(1, 2)
        side.frames()
        side.protocol.disconnected()
        self.clock(side, a=2)
        side.attach(upcoming=2)
        assert self.clocks(side) == [[2], {"a": 2}]


class TestErrors:
    @pytest.mark.parametrize(
        "code",
        ["spec_mismatch", "monitor_taken", "unknown_spec", "unknown_session", "session_closed",
         "forbidden", "unauthorized", "bad_attach", "replaced"],
    )  # fmt: skip
    @pytest.mark.parametrize("flag", [{}, {"fatal": True}])
    def test_some_end_the_link(self, side: Side, code: str, flag: Frame) -> None:
        (error,) = side.receive("error", code=code, message="no", **flag)
        assert (str(error), error.fatal) == (f"{code}: no", True)

    @pytest.mark.parametrize(
        ("code", "fatal"), [("shutting_down", True), ("busy", None), ("forbidden", False)]
    )
    def test_others_do_not(self, side: Side, code: str, fatal: Optional[bool]) -> None:
        flag = {} if fatal is None else {"fatal": fatal}
        (error,) = side.receive("error", code=code, message="no", **flag)
        assert not error.fatal

    @pytest.mark.parametrize(
        "text",
        ["", "{", "[]", "1", "{}", '{"type":"ack"}', '{"type":"ack","upto":null}',
         '{"type":"attached"}', '{"type":"decision","seq":[]}', '{"type":"error"}', b"\xff",
         '{"type":["ack"]}'],
    )  # fmt: skip
    def test_what_is_no_frame_is_told(self, side: Side, text: str) -> None:
        with pytest.raises(LinkError, match="bad_frame"):
            side.protocol.receive(text)

    def test_a_bad_attached_changes_nothing(self, side: Side) -> None:
        side.send(1)
        with pytest.raises(LinkError):
            side.attach(streams=None)
        assert side.protocol.attached is None
        assert side.frames() == []

    def test_unknown_frames_are_left_alone(self, side: Side) -> None:
        assert side.receive("greeting", text="hello") == []

    def test_violations_are_passed_on(self, side: Side) -> None:
        assert side.receive("violation", n=3, property="p") == [
            Violation({"n": 3, "property": "p"})
        ]


class TestDetaching:
    def test_it_comes_after_all_else_and_once(self, side: Side) -> None:
        side.attach()
        side.send(1, 2)
        side.protocol.clock([("/a", "topic", 2)])
        side.protocol.detach()
        assert [frame["type"] for frame in side.frames()] == ["events", "clock", "detach"]
        assert side.frames() == []
        assert not side.protocol.done
        side.receive("detached")
        assert side.protocol.done

    def test_nothing_more_is_taken(self, side: Side) -> None:
        side.attach()
        side.protocol.detach()
        assert side.send(1) == [False]
        answer = side.ask()
        assert isinstance(answer, Answer)
        assert answer.reason == "the link is closing"

    def test_it_is_said_again_on_a_new_connection(self, side: Side) -> None:
        side.attach()
        side.send(1)
        side.protocol.detach()
        side.frames()
        side.reconnect(upcoming=1)
        assert [frame["type"] for frame in side.frames()] == ["event", "detach"]

    @pytest.mark.parametrize("values", [[], [1]])
    def test_without_a_connection_it_needs_one_only_to_deliver(
        self, side: Side, values: List[int]
    ) -> None:
        side.send(*values)
        side.protocol.detach()
        assert side.protocol.done == (not values)


def test_what_is_said_of_streams_is_told_once_a_connection(side: Side) -> None:
    assert side.protocol.report("/a", "topic", time_source="field")
    assert side.frames() == []
    side.attach()
    first = {"stream": "/a", "kind": "topic", "time_source": "field"}
    assert side.frames() == [{"type": "report", "streams": [first]}]
    assert not side.protocol.report("/a", "topic", time_source="field")
    assert side.protocol.report("/b", "topic", trouble="bad")
    second = {"stream": "/b", "kind": "topic", "trouble": "bad"}
    assert side.frames() == [{"type": "report", "streams": [second]}]
    side.reconnect(1)
    assert side.protocol.report("/b", "topic", trouble="")
    assert side.frames() == [{"type": "report", "streams": [first, {**second, "trouble": ""}]}]
    assert side.frames() == []
