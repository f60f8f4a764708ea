"""The state of a link, frame by frame: asks, what was done with them, and clocks."""

from __future__ import annotations

from typing import Any, List

import pytest
from oracle_adapter import Answer, LinkError, should_pass
from oracle_adapter.marks import MAX_CLOCKS
from oracle_adapter.notices import Answered
from tests.adapters.common.side import Side, answer_in


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
        side.protocol.handled(answer, False, answer.why)
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
        assert side.protocol.stats().unavailable == 1
        side.protocol.handled(answer, False, answer.why)  # there is nothing to report on
        side.attach()
        assert [frame["type"] for frame in side.frames()] == ["event"]

    def test_what_is_too_large_to_be_judged_is_denied_whatever_the_policy(self, side: Side) -> None:
        side.attach(limits={"max_frame": 4000})
        answer = side.ask("x" * 4000)
        assert isinstance(answer, Answer)
        assert should_pass(answer, "pass") == (False, "decision")
        assert "too large for a frame" in answer.reason
        side.protocol.close()
        answer = side.ask("x" * 4000)
        assert isinstance(answer, Answer)
        assert should_pass(answer, "pass") == (True, "unavailable"), "nobody would judge it anyway"

    def test_losses_are_told_once_of_each_kind(self) -> None:
        side = Side(capacity=4)
        side.attach(limits={"max_frame": 4000})
        side.send("x" * 4000, 1, 2, 3, "x" * 4000, 4, 5, 6)
        large, full = side.receive("ack", upto=0)
        assert "too large for a frame" in large.message
        assert "the queue of 4 events is full" in full.message
        side.frames()
        side.receive("ack", upto=4)
        side.send("x" * 4000, *range(5))
        (again,) = side.receive("ack", upto=4)
        assert again.message == full.message

    def test_what_is_too_large_is_told_once_of_each_stream(self, side: Side) -> None:
        side.attach(limits={"max_frame": 4000})
        for stream in ("/map", "/scan", "/map"):
            side.protocol.send(None, f'"stream":"{stream}","kind":"topic","data":"{"x" * 4000}"}}')
        told = [notice.message.partition(" is too")[0] for notice in side.receive("ack", upto=0)]
        assert told == ['an event of "/map"', 'an event of "/scan"']

    def test_closing_answers_all_and_tells_what_was_done(self, side: Side) -> None:
        side.attach()
        side.queued()
        side.frames()
        side.protocol.close()
        answer = answer_in(side.protocol.take_notices())
        assert (answer.why, answer.reason) == ("unavailable", "the link is closing")
        assert isinstance(side.ask(), Answer)
        side.protocol.handled(answer, False, answer.why)
        side.protocol.detach()
        assert [frame["type"] for frame in side.frames()] == ["outcome", "detach"]

    def test_a_refused_event_is_denied_whatever_the_policy(self, side: Side) -> None:
        side.attach()
        side.queued()
        side.frames()
        error, answered = side.receive("error", code="bad_stamp", message="in the future", seq=1)
        assert isinstance(error, LinkError)
        assert (error.code, error.seq, error.fatal) == ("bad_stamp", 1, False)
        answer = answer_in([answered])
        assert answer.reason == "bad_stamp: in the future"
        assert should_pass(answer, "pass") == (False, "decision")
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


class TestHandlings:
    def answered(self, side: Side) -> Answer:
        asked = side.queued()
        side.frames()
        return answer_in(side.receive("decision", seq=asked.seq, decision="allow"))

    def test_one_follows_its_event(self, side: Side) -> None:
        side.attach()
        answer = self.answered(side)
        side.protocol.handled(answer, True, "decision")
        assert side.frames() == [{"type": "outcome", "seq": 1, "passed": True, "why": "decision"}]

    def test_one_that_may_not_have_arrived_is_sent_again(self, side: Side) -> None:
        side.attach()
        side.protocol.handled(self.answered(side), True, "decision")
        side.frames()
        side.receive("ack", upto=1)
        side.reconnect(upcoming=2)
        assert [frame["type"] for frame in side.frames()] == ["outcome"]

    def test_one_that_has_arrived_is_not(self, side: Side) -> None:
        side.attach()
        side.protocol.handled(self.answered(side), True, "decision")
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

    def test_those_of_an_outage_stay_between_its_events(self, side: Side) -> None:
        """By the clock of when it began all its events were far ahead, and judged at that time."""
        side.attach()
        side.protocol.disconnected()
        for ms in range(0, 2_000, 10):
            self.clock(side, a=ms * 10**6)
            if ms % 500 == 0:
                side.send(ms)
        side.attach()
        sent = self.clocks(side)
        assert [frame for frame in sent if isinstance(frame, list)] == [[0], [500], [1000], [1500]]
        told = [frame["a"] // 10**6 for frame in sent if isinstance(frame, dict)]
        assert told == [0, 500, 1000, 1500, 1990]

    def test_of_many_that_wait_some_are_forgotten_and_none_of_the_ends(self) -> None:
        last = 2_500
        side = Side(capacity=2 * last)
        for second in range(last + 1):
            self.clock(side, a=second * 10**9)
            side.send(second)
        side.attach()
        told = [frame["a"] // 10**9 for frame in self.clocks(side) if isinstance(frame, dict)]
        assert (told[0], told[-1], told) == (0, last, sorted(told))
        assert MAX_CLOCKS / 2 <= len(told) <= MAX_CLOCKS
        assert max(after - before for before, after in zip(told, told[1:])) <= 4

    def test_it_waits_for_events_sent_again(self, side: Side) -> None:
        side.attach()
        side.send(1, 2)
        side.frames()
        side.protocol.disconnected()
        self.clock(side, a=2)
        side.attach(upcoming=2)
        assert self.clocks(side) == [[2], {"a": 2}]
