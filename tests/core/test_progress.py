"""No deadlock with an end to `max_delay`: every state of a small robot that can be reached can go on to the end.

The robot is the paper's worst case. A topic is filtered and ordered; the node that hears it calls a filtered ordered
service from inside its callback, and publishes on an ordered topic once it has the response. No clock speaks for any
stream. Queues between the nodes and the oracle hold one message. All interleavings are explored.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from oracle_server.core.errors import SpecError
from oracle_server.core.events import StreamKey
from oracle_server.core.ordering.reorder import Released, ReorderBuffer
from oracle_server.specfiles.load import parse_spec

TOPIC, DONE = StreamKey("/percentage", "topic"), StreamKey("/status", "topic")
REQUEST, RESPONSE = StreamKey("/SetLED", "request"), StreamKey("/SetLED", "response")
STREAMS = (TOPIC, DONE, REQUEST, RESPONSE)
MESSAGES = 2


@dataclass
class Robot:
    """One state: what was sent, what is on its way, what each node waits for, and the oracle's order."""

    order: ReorderBuffer[StreamKey]
    sent: int = 0
    heard: int = 0
    node_waits: bool = False
    service_called: bool = False
    stamp: int = 0
    now: int = 0
    transit: dict[StreamKey, int] = field(default_factory=dict)

    @property
    def finished(self) -> bool:
        idle = not self.node_waits and not self.service_called and not self.transit
        return self.sent == MESSAGES and self.heard == 0 and idle and len(self.order) == 0

    def key(self) -> object:
        """The state without absolute times, which only differ by how long it took to get there."""
        held = sorted((stamp, item) for (stamp, _), item in zip(self.order._heap, self.order.held, strict=True))
        waits = tuple(sorted(deadline - self.now for deadline, _, n in self.order._deadlines if n in self.order._held))
        reached = tuple(sorted((s[1], at) for s, at in self.order.frontiers.items() if at is not None))
        nodes = (self.sent, self.heard, self.node_waits, self.service_called, tuple(sorted(self.transit.items())))
        return (*nodes, self.stamp, tuple(held), waits, reached, self.order.present)

    def moves(self) -> Iterator[Robot]:
        """Every state that is one step away."""
        if self.sent < MESSAGES and TOPIC not in self.transit:
            after = self._copy()
            after.sent += 1
            after._emit(TOPIC)
            yield after
        for stream, stamp in self.transit.items():
            after = self._copy()
            del after.transit[stream]
            after._let_through(after.order.push(stream, ("m", stream), "", stamp, after.now))
            yield after
        if self.heard and not self.node_waits and REQUEST not in self.transit:
            after = self._copy()
            after.heard -= 1
            after.node_waits = True
            after._emit(REQUEST)
            yield after
        if self.service_called and RESPONSE not in self.transit:
            after = self._copy()
            after.service_called = False
            after._emit(RESPONSE)
            yield after
        if self.order.next_deadline is not None:
            after = self._copy()
            after.now += 1
            after._let_through(after.order.advance(after.now))
            yield after

    def _copy(self) -> Robot:
        return copy.deepcopy(self)

    def _emit(self, stream: StreamKey) -> None:
        self.stamp += 1
        self.transit[stream] = self.stamp

    def _let_through(self, released: list[Released[StreamKey]]) -> None:
        for stream in (r.item for r in released):
            self.heard += stream == TOPIC
            self.service_called |= stream == REQUEST
            if stream == RESPONSE:
                self.node_waits = False
                self._emit(DONE)


def explore(max_delay: int | None) -> tuple[int, int]:
    """How many states can be reached, and from how many of them the end can't."""
    order: ReorderBuffer[StreamKey] = ReorderBuffer(max_delay, capacity=100)
    order.open("m", STREAMS)
    start = Robot(order)
    before: dict[object, set[object]] = {start.key(): set()}
    finished, todo = set(), [start]
    while todo:
        state = todo.pop()
        if state.finished:
            finished.add(state.key())
        for after in state.moves():
            if after.key() not in before:
                before[after.key()] = set()
                todo.append(after)
            before[after.key()].add(state.key())
    can_end, todo_keys = set(finished), list(finished)
    while todo_keys:
        for earlier in before[todo_keys.pop()] - can_end:
            can_end.add(earlier)
            todo_keys.append(earlier)
    return len(before), len(before) - len(can_end)


@pytest.mark.parametrize("max_delay", [1, 2])
def test_with_an_end_to_the_wait_every_state_can_go_on(max_delay: int) -> None:
    states, stuck = explore(max_delay)
    assert states > 100
    assert stuck == 0


def test_without_one_the_paper_s_robot_deadlocks_and_check_foretells_it() -> None:
    _, stuck = explore(None)
    assert stuck > 0
    spec = (Path(__file__).parent / "deadlock.yaml").read_text()
    with pytest.raises(SpecError, match="deadlock: /percentage -> /SetLED -> /percentage"):
        parse_spec(spec, "deadlock.yaml")
    assert parse_spec(spec.replace("max_delay: none", "max_delay: 100ms"), "deadlock.yaml")
