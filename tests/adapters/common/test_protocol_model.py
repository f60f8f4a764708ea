"""Whatever the network does: every event arrives once, in order, and every ask is answered."""

from __future__ import annotations

import json
from collections import deque
from typing import Any, Deque, Dict, List, Optional, Set

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)  # fmt: skip
from oracle_adapter import Answer, outbox
from oracle_adapter.notices import Answered
from oracle_adapter.protocol import Hello, Protocol
from oracle_adapter.queued import HEAD, Queued

Frame = Dict[str, Any]


class Server:
    """What the contract says of the other side, in memory; `memory` is all that it knows."""

    def __init__(self, first: int) -> None:
        self.first = first
        self.events: List[Frame] = []
        self.committed = 0  # of `events`
        self.decided: Set[int] = set()
        self.outcomes: Dict[int, Frame] = {}
        self.clocks: List[Frame] = []

    @property
    def next(self) -> int:
        return self.first + len(self.events)

    def read(self, frame: Frame) -> List[Frame]:
        """Take in one frame and return the answers that are due at once."""
        if frame["type"] == "events":
            return [answer for event in frame["events"] for answer in self.read(event)]
        if frame["type"] == "event":
            return self._event(frame)
        if frame["type"] == "outcome":
            assert frame["seq"] < self.next, "an outcome came before its event"
            self.outcomes[frame["seq"]] = frame
        elif frame["type"] == "clock":
            for item in frame["stamps"]:
                assert item["stamp"] <= self._last_value(), "a clock overtook an event"
            self.clocks.append(frame)
        elif frame["type"] == "detach":
            return [{"type": "detached"}]
        return []

    def _event(self, event: Frame) -> List[Frame]:
        seq = event["seq"]
        assert self.first <= seq <= self.next, "a gap"
        if seq == self.next:
            self.events.append(event)
            return []
        assert self.events[seq - self.first] == event, "another event under an old number"
        return [self.decision(seq)] if seq in self.decided else []

    def _last_value(self) -> int:
        return int(self.events[-1]["data"]) if self.events else 0

    def commit(self) -> Frame:
        # What is in the history has been judged, and its decision sent.
        self.committed = len(self.events)
        return {"type": "ack", "upto": self.next - 1}

    def undecided(self) -> List[int]:
        return [e["seq"] for e in self.events if e["ask"] and e["seq"] not in self.decided]

    def decision(self, seq: int) -> Frame:
        self.decided.add(seq)
        value = self.events[seq - self.first]["data"]
        return {"type": "decision", "seq": seq, "decision": "allow" if value % 2 else "deny"}

    def crash(self) -> None:
        del self.events[self.committed :]
        self.decided = {seq for seq in self.decided if seq < self.next}


class Wire(RuleBasedStateMachine):
    """The steps of both sides and of the network, in any order."""

    capacity = most = 10_000
    narrow = False

    @initialize(first=st.sampled_from([1, 8]))
    def begin(self, first: int) -> None:
        self.server = Server(first)
        self.protocol = Protocol(Hello("uav1", "i1"), self.capacity)
        self.connected = False
        self.up: Deque[str] = deque()
        self.down: Deque[Frame] = deque()
        self.value = 0
        self.queued: List[int] = []
        self.missed = 0
        self.credit: Optional[int] = None
        self.asks: List[Queued] = []
        self.answers: Dict[int, Answer] = {}
        self.reported: Dict[int, bool] = {}

    # The robot

    def _body(self, ask: bool) -> str:
        self.value += 1
        return f'"ask":{json.dumps(ask)},"data":{self.value}}}'

    def _count(self, queued: bool) -> None:
        if queued:
            self.queued.append(self.value)
        else:
            self.missed += 1

    @rule(count=st.integers(1, 5))
    def send(self, count: int) -> None:
        for _ in range(count):
            self._count(self.protocol.send(None, self._body(ask=False)))

    @rule()
    def ask(self) -> None:
        asked = self.protocol.ask(None, self._body(ask=True))
        self._count(isinstance(asked, Queued))
        if isinstance(asked, Queued):
            self.asks.append(asked)

    @rule()
    def clock(self) -> None:
        self.protocol.clock([("/a", "topic", self.queued[-1] if self.queued else 0)])

    @precondition(lambda self: self.asks)
    @rule(data=st.data())
    def expire(self, data: st.DataObject) -> None:
        self.protocol.expire(data.draw(st.sampled_from(self.asks)))
        self._notice()

    @precondition(lambda self: len(self.answers) > len(self.reported))
    @rule(passed=st.booleans())
    def report(self, passed: bool) -> None:
        number = min(set(self.answers) - set(self.reported))
        self.reported[number] = passed
        answer = self.answers[number]
        self.protocol.handled(answer, passed, answer.why)

    # The network

    @precondition(lambda self: not self.connected)
    @rule(credit=st.sampled_from([None, 0, 2]))
    def connect(self, credit: Optional[int] = None) -> None:
        self.connected = True
        self.credit = credit
        assert json.loads(self.protocol.hello())["type"] == "attach"
        self.down.append(
            {
                "type": "attached",
                "monitor": "uav1",
                "session": "s1",
                "streams": [],
                "next": self.server.next,
                "limits": {"max_batch": 3, "credit": credit},
            }
        )
        if self.server.committed:
            upto = self.server.first + self.server.committed - 1
            self.down.append({"type": "ack", "upto": upto})

    @precondition(lambda self: self.connected)
    @rule()
    def disconnect(self) -> None:
        self.connected = False
        self.up.clear()
        self.down.clear()
        self.protocol.disconnected()

    @rule(count=st.integers(1, 3))
    def write(self, count: int) -> None:
        for _ in range(count):
            queued = self.protocol.stats().queued  # before what was acked already is let go of
            frame = self.protocol.next_frame()
            if frame is not None:
                assert self.connected
                self._spend(json.loads(frame), queued)
                self.up.append(frame)

    def _spend(self, frame: Frame, queued: int) -> None:
        """Without credit only asks go, what is before them, and what a full queue would lose."""
        if self.credit is None or frame["type"] not in ("event", "events"):
            return
        events = frame.get("events", [frame])
        self.credit -= len(events)
        newest_ask = max((self.queued[ask.number - 1] for ask in self.asks), default=0)
        urgent = events[-1]["data"] <= newest_ask or queued > 0.75 * self.most
        assert self.credit >= 0 or urgent

    @precondition(lambda self: self.connected and self.credit is not None)
    @rule(events=st.integers(1, 4))
    def grant(self, events: int) -> None:
        self.down.append({"type": "credit", "events": events})
        self.credit = (self.credit or 0) + events

    @rule(count=st.integers(1, 3))
    def read(self, count: int) -> None:
        for _ in range(min(count, len(self.down))):
            self.protocol.receive(json.dumps(self.down.popleft()))
        self._notice()

    @precondition(lambda self: self.connected)
    @rule()
    def flow(self) -> None:
        """A while without trouble: all that is under way arrives."""
        self.read(100)
        self.write(100)
        self.serve(100)
        self.read(100)

    @precondition(lambda self: self.connected)
    @rule()
    def reconnect(self) -> None:
        self.disconnect()
        self.connect()
        self.read(1)

    def _notice(self) -> None:
        for notice in self.protocol.take_notices():
            if isinstance(notice, Answered):
                assert notice.event.number not in self.answers, "answered twice"
                self.answers[notice.event.number] = notice.answer

    # The server

    @rule(count=st.integers(1, 3))
    def serve(self, count: int) -> None:
        for _ in range(min(count, len(self.up))):
            self.down.extend(self.server.read(json.loads(self.up.popleft())))

    @precondition(lambda self: self.server.undecided())
    @rule(data=st.data())
    def decide(self, data: st.DataObject) -> None:
        decision = self.server.decision(data.draw(st.sampled_from(self.server.undecided())))
        if self.connected:
            self.down.append(decision)

    @rule()
    def commit(self) -> None:
        while self.server.undecided():
            self.down.append(self.server.decision(self.server.undecided()[0]))
        ack = self.server.commit()
        self.down.append(ack)
        if not self.connected:
            self.down.clear()

    @rule()
    def crash(self) -> None:
        if self.connected:
            self.disconnect()
        self.server.crash()

    # What holds

    @invariant()
    def in_order_without_gap_or_double(self) -> None:
        values = [event["data"] for event in self.server.events]
        assert values == self.queued[: len(values)]

    @invariant()
    def the_queue_has_a_bound(self) -> None:
        assert self.protocol.stats().queued <= self.most

    def teardown(self) -> None:
        if not hasattr(self, "server"):
            return
        if self.connected:
            self.disconnect()
        self.connect()
        self._settle()
        self._check_losses()
        assert [event["data"] for event in self.server.events] == self.queued
        assert self.protocol.stats().queued == 0
        assert self.protocol.stats().acked == len(self.queued)
        assert sorted(self.answers) == [ask.number for ask in self.asks]
        self._check_answers()

    def _settle(self) -> None:
        if self.credit is not None:
            self.grant(1000)
        for _ in range(3):
            while self.down or self.up or self._writes():
                self.read(100)
                self.write(100)
                self.serve(100)
            self.commit()
        self.read(100)

    def _writes(self) -> bool:
        before = len(self.up)
        self.write(1)
        return len(self.up) > before

    def _check_losses(self) -> None:
        assert self.protocol.stats().lost == self.missed
        self.send(1)  # takes along what was lost last; there is room for it now
        self._settle()
        assert sum(event.get("lost", 0) for event in self.server.events) == self.missed

    def _check_answers(self) -> None:
        for ask in self.asks:
            answer = self.answers[ask.number]
            if answer.why == "decision":
                value = self.server.events[(ask.seq or 0) - self.server.first]["data"]
                assert answer.decision == ("allow" if value % 2 else "deny")
            if ask.number in self.reported and not self.narrow:
                outcome = self.server.outcomes[ask.seq or 0]
                assert outcome["passed"] is self.reported[ask.number]
                assert outcome["why"] == answer.why


class NarrowWire(Wire):
    """The same with a queue that overflows, and loses outcomes too where it does."""

    capacity = most = 4
    narrow = True


class SmallRoom(Wire):
    """The same with a queue in which there is no room for many bytes."""

    most = 4
    narrow = True
    room = 4 * (HEAD + 28)

    def _body(self, ask: bool) -> str:
        return super()._body(ask).rjust(28)


@pytest.mark.parametrize("wire", [Wire, NarrowWire, SmallRoom])
def test_any_course_of_events(wire: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outbox, "ROOM", getattr(wire, "room", outbox.ROOM))
    run_state_machine_as_test(
        wire,
        settings=settings(
            max_examples=300,
            stateful_step_count=60,
            deadline=None,
            suppress_health_check=list(HealthCheck),
        ),
    )
