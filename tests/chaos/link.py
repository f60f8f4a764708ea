"""A monitor's end of the wire: it sends its events, and again from `next` after each loss, until all is settled."""

from __future__ import annotations

import asyncio
import json
import random
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException

from tests.chaos.pace import Pace

WINDOW = 300
"""Events that may be on their way: sent, and not acked yet."""
NOT_HERE = ("moved", "history_unavailable", "shutting_down")
"""What a server answers that does not have a session, or not any more."""
LOST = (OSError, EOFError, WebSocketException)
"""What a connection fails with when its other end is gone."""
Frame = dict[str, Any]


class Place(Protocol):
    """Where a monitor attaches, once it is up."""

    @property
    def up(self) -> asyncio.Event: ...

    @property
    def attach_url(self) -> str: ...


@dataclass
class Link:
    """One monitor with its whole life's `events`, numbered from 1 and in order of their stamps.

    It sends nothing before the `gate` is open. `moved` is called with the number of events newly acked, and of
    decisions newly made, as they become known; and with 0 after each attach. `end` is a stamp beyond all events.
    """

    served: Place
    attach: Frame
    events: list[Frame]
    end: int
    random: random.Random
    gate: asyncio.Event
    moved: Callable[[int], None]
    waited_for: bool = True
    """Whether events are in order whatever comes when, so that one is decided as it was where that was not kept."""
    moves: bool = False
    """Whether another server may go on with its session."""
    skips: bool = False
    """Whether events may be skipped for want of space, also where they were decided before that was not kept."""
    pace: Pace | None = None
    """How far it may go; without one, to the end."""
    pause: float = 0.02
    """Seconds before another server is asked, as adapters pause."""
    decided: Callable[[int, float], None] = lambda seq, asked: None
    """Called as a decision is read, with the number of its event and when that was sent last (s, monotonic)."""
    acked: int = 0
    attaches: int = 0
    decisions: dict[int, Frame] = field(default_factory=dict)
    first: dict[int, Frame] = field(default_factory=dict)
    """Decisions as they were told first; where one that was not kept is made anew, `decisions` has the last one."""
    attached: asyncio.Event = field(default_factory=asyncio.Event)
    done: asyncio.Event = field(default_factory=asyncio.Event)

    def __post_init__(self) -> None:
        self._undecided = {event["seq"] for event in self.events if event["ask"]}
        self._asked: dict[int, float] = {}
        self._claimed: list[Frame] = []
        self._room = asyncio.Event()
        self._socket: ClientConnection | None = None

    def __str__(self) -> str:
        """What it waits for."""
        left = f"{self.acked} of {len(self.events)} acked, {sorted(self._undecided)} not decided"
        return f"{self.attach['monitor']} of {self.attach['session']}: attached {self.attaches} times, {left}"

    async def run(self) -> None:
        """Stay attached, over as many connections as it takes; ends only when it is cancelled."""
        while True:
            await self.served.up.wait()
            try:
                # without a bound on what waits to be read: a send that waits for the end of a closing connection
                # would else wait for its own reader
                async with connect(
                    self.served.attach_url, compression=None, proxy=None, ping_interval=None, max_queue=None
                ) as self._socket:
                    await self._talk(self._socket)
            except LOST:
                continue

    def cut(self) -> None:
        """Lose the connection without a word, whatever was on its way."""
        if self._socket is not None:
            self._socket.transport.abort()

    async def overtake(self) -> None:
        """Attach from elsewhere in the same process, which ends the connection that stands; and lose that one too."""
        async with connect(self.served.attach_url, compression=None, proxy=None, ping_interval=None) as other:
            await other.send(json.dumps(self.attach))
            await other.recv()
            other.transport.abort()

    async def _talk(self, socket: ClientConnection) -> None:
        await socket.send(json.dumps(self.attach))
        answer = json.loads(await socket.recv())
        if answer.get("code") == "replaced":
            return  # overtaken before it was told that it is attached
        if self.moves and answer.get("code") in NOT_HERE:
            await asyncio.sleep(self.pause)
            return
        assert answer["type"] == "attached", answer
        assert answer["next"] > self.acked, f"{answer['next']} is next, though {self.acked} was acked"
        self._claimed = answer["streams"]
        self._move_on(answer["next"] - 1)
        self.attaches += 1
        self.attached.set()
        self.moved(0)
        sending = asyncio.create_task(self._send(socket, answer["next"]))
        try:
            async for text in socket:
                await self._take(socket, json.loads(text))
        finally:
            sending.cancel()
            (ended,) = await asyncio.gather(sending, return_exceptions=True)
            if not isinstance(ended, (*LOST, asyncio.CancelledError, type(None))):
                raise ended

    async def _send(self, socket: ClientConnection, upcoming: int) -> None:
        """Ask again what was never answered, then send all from number `upcoming` on, and the last clock."""
        await self.gate.wait()
        for seq in sorted(seq for seq in self._undecided if seq < upcoming):
            await self._send_events(socket, [self.events[seq - 1]])
        while upcoming <= len(self.events):
            size = self.random.choice((1, 1, 1, 8, 64))
            batch = self.events[upcoming - 1 : upcoming - 1 + size]
            if self.pace is not None and not (batch := self.pace.allows(batch)):
                await self._tell_time(socket, upcoming)
                await self.pace.reaches(self.events[upcoming - 1]["stamp"])
                continue
            await self._send_events(socket, batch)
            upcoming += len(batch)
            full = upcoming - self.acked > WINDOW
            if full or self.random.random() < 0.3:
                await self._tell_time(socket, upcoming)
            while upcoming - self.acked > WINDOW:
                self._room.clear()
                await self._room.wait()
        await self._tell_time(socket, upcoming)

    async def _send_events(self, socket: ClientConnection, batch: list[Frame]) -> None:
        self._asked |= {event["seq"]: time.monotonic() for event in batch if event["ask"]}
        await socket.send(json.dumps(batch[0] if len(batch) == 1 else {"type": "events", "events": batch}))

    async def _tell_time(self, socket: ClientConnection, upcoming: int) -> None:
        """Say that nothing older than the next event will come."""
        stamp = self.events[upcoming - 1]["stamp"] if upcoming <= len(self.events) else self.end
        stamps = [{"stream": s["name"], "kind": s["kind"], "stamp": stamp} for s in self._claimed]
        await socket.send(json.dumps({"type": "clock", "stamps": stamps}))

    async def _take(self, socket: ClientConnection, frame: Frame) -> None:
        match frame:
            case {"type": "ack", "upto": upto}:
                assert upto >= self.acked, f"acked back from {self.acked} to {upto}"
                self._move_on(upto)
            case {"type": "decision", "seq": seq}:
                self.decided(seq, self._asked[seq])
                self.first.setdefault(seq, frame)
                known = self.decisions.setdefault(seq, frame)
                unjudged = set(known["verdicts"].values()) == {"unknown"}
                if unjudged or self.skips or not self.waited_for:
                    # It was not judged, or sent again when it or one before it could not be kept.
                    self.decisions[seq] = known = frame
                assert frame == known, f"an event was decided differently the second time: {known}, {frame}"
                await socket.send(json.dumps({"type": "outcome", "seq": seq, "passed": True, "why": "decision"}))
                if seq in self._undecided:
                    self._undecided.discard(seq)
                    self._settle(1)
            case {"type": "error", "code": "replaced" | "shutting_down"} | {"type": "violation" | "credit"}:
                pass
            case {"type": "error", "code": "history_unavailable"} if self.moves:
                pass
            case _:
                raise AssertionError(frame)

    def _move_on(self, upto: int) -> None:
        new, self.acked = upto - self.acked, upto
        self._room.set()
        self._settle(new)

    def _settle(self, count: int) -> None:
        if self.acked == len(self.events) and not self._undecided:
            self.done.set()
        if count:
            self.moved(count)
