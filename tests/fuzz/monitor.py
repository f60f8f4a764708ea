"""A monitor that mostly behaves: it attaches, speaks, is cut off, comes back, and sometimes says what it should not."""

from __future__ import annotations

import asyncio
import contextlib
import json
import random
from collections import Counter
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, WebSocketException

from tests.chaos.served import PATIENCE
from tests.fuzz.frames import Event, Frame, Key, Sent, Writer, batch
from tests.fuzz.numbers import Numbers

T = TypeVar("T")

LOST = (OSError, EOFError, WebSocketException)
"""What a connection fails with when its other end is gone."""
_OVER = {"session_closed", "session_ended"}
_WINDOW = 30
"""Frames after which the monitor waits until the server has taken them off the socket."""
LAST = 2**53 - 1
"""The highest number that an event can have."""
_KEPT = 200
"""Events that are kept to be sent again."""


async def soon(what: Awaitable[T]) -> T:
    """What is awaited, which must come in time; asyncio's own error would pass for a lost connection."""
    try:
        return await asyncio.wait_for(what, PATIENCE)
    except TimeoutError:
        raise AssertionError(f"not within {PATIENCE} s: {what}") from None


@dataclass
class Told:
    """What the server has pushed to the monitors of a session."""

    violations: dict[int, Frame] = field(default_factory=dict)
    decisions: dict[tuple[str, int], Frame] = field(default_factory=dict)
    codes: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)


@dataclass
class Monitor:
    """One monitor of a session: `run` sends its frames, and ends with its last event committed."""

    url: str
    name: str
    session: str
    spec: str
    clock: str
    writer: Writer
    told: Told
    sending: Callable[[], None]
    numbers: Numbers = field(default_factory=Numbers)
    frames: list[Sent] = field(default_factory=list)
    over: bool = False
    claimed: list[Key] = field(default_factory=list)
    attached: asyncio.Event = field(default_factory=asyncio.Event)

    def __post_init__(self) -> None:
        self.chance: random.Random = self.writer.chance
        self._instances = 1
        self._socket: ClientConnection | None = None
        self._reader: asyncio.Task[None] | None = None
        self._kept: dict[int, Event] = {}
        self._detached = asyncio.Event()
        self._at: int = 0

    async def run(self, count: int) -> None:
        """Send so many frames, unless the session ends before, then detach."""
        while len(self.frames) < count and not self.over:
            try:
                if self._socket is None:
                    await self._attach()
                else:
                    await self._step()
            except LOST:
                await self._leave()
        await self._end()

    async def _end(self) -> None:
        """Detach, and wait until all is committed; over as many connections as it takes."""
        while not self.over and not self._detached.is_set():
            try:
                if self._socket is None:
                    await self._attach(new=False, fate=False)
                elif self._reader is not None:
                    if self.chance.random() < 0.2:
                        await self._events([self.writer.event(LAST, self.claimed)], whole=True)
                    await self._socket.send('{"type":"detach"}')
                    await soon(self._reader)
                    await self._leave()
            except LOST:
                await self._leave()
        await self._leave()

    # One step

    async def _step(self) -> None:
        fate = self.chance.random()
        if fate < 0.002:
            await self._overtake()
        elif fate < 0.004:
            await self._intrude()
        elif fate < 0.008:
            await self._vanish()
        elif fate < 0.010:
            await self._send(Sent('{"type":"detach"}'))
            if self._reader is not None:
                await soon(self._reader)
            await self._leave()
        else:
            await self._speak(fate)

    async def _speak(self, fate: float) -> None:
        chance, writer = self.chance, self.writer
        if fate < 0.62:
            await self._events([writer.event(self._next(), self.claimed)], whole=True)
        elif fate < 0.74:
            await self._batch()
        elif fate < 0.80:
            await self._send(Sent(json.dumps(writer.clock(self.claimed), separators=(",", ":"))))
        elif fate < 0.85:
            await self._send(Sent(self._outcomes()))
        elif fate < 0.90:
            await self._again()
        elif fate < 0.95:
            await self._events([writer.unsound(self._next())], whole=True)
        elif fate < 0.97:
            await self._events([writer.unreadable(self._next())], whole=True)
        elif fate < 0.98:
            await self._send(Sent(json.dumps(writer.report(self.claimed))))
        elif fate < 0.999:
            await self._send(Sent(writer.noise()))
        else:
            await self._send(Sent(chance.choice((b"bytes", b"\xff", '{"type":"event","data":"' + "x" * 2**20 + '"}'))))

    async def _batch(self) -> None:
        events: list[Event] = []
        upcoming = self.numbers.high
        whole = self.chance.random() < 0.5
        for _ in range(self.chance.choice((1, 2, 2, 5, 20))):
            upcoming += 1 if self.chance.random() < 0.98 else self._jump()
            odd = not whole and self.chance.random() < 0.1
            events.append(self.writer.unsound(upcoming) if odd else self.writer.event(upcoming, self.claimed))
        if self.chance.random() < 0.03:
            events.append(self.writer.unreadable(upcoming + 1))
            events = [Event(e.seq, e.stream, e.kind, e.text, sound=False) for e in events]
        await self._events(events, whole=False)

    async def _again(self) -> None:
        """Send again what was sent, as it was, or another event under its number."""
        if not self.numbers.sent:
            return
        seq = self.chance.choice(list(self.numbers.sent)[-300:])
        event = self.chance.choice(self.numbers.sent[seq])
        if self.chance.random() < 0.3:
            event = self.writer.event(seq, self.claimed)
        elif not event.sound:
            return
        sound = event.sound and (event.stream, event.kind) in self.claimed
        await self._events([Event(event.seq, event.stream, event.kind, event.text, sound)], whole=True)

    def _next(self) -> int:
        return self.numbers.high + (1 if self.chance.random() < 0.985 else self._jump())

    def _jump(self) -> int:
        """How far a number jumps: mostly a bit, seldom beyond all that are left."""
        return self.chance.choice((2, 3, 10, 1000, 2**31) if self.numbers.high < 2**52 else (1, 2))

    def _outcomes(self) -> str:
        recent = list(self.numbers.sent)[-50:] or [1]
        outcomes = [self.writer.outcome(self.chance.choice(recent)) for _ in range(self.chance.randint(1, 4))]
        if len(outcomes) == 1:
            return json.dumps({"type": "outcome"} | outcomes[0])
        return json.dumps({"type": "outcomes", "outcomes": outcomes}, separators=(",", ":"))

    async def _events(self, events: list[Event], *, whole: bool) -> None:
        for event in events:
            self.numbers.add(event)
            if event.sound:
                self._kept[event.seq] = event
        await self._send(Sent(events[0].text, events) if whole else batch(events))

    async def _send(self, sent: Sent) -> None:
        self._note(sent)
        assert self._socket is not None
        await self._socket.send(sent.text)
        self._at += 1
        if self._at % _WINDOW == 0:
            await soon(await self._socket.ping())

    def _note(self, sent: Sent) -> None:
        self.frames.append(sent)
        self.sending()

    # Connections

    async def _attach(self, *, new: bool = True, fate: bool = True) -> None:
        """Connect, as a process that is `new` or not, and send again what was not acked, or go on without.

        Without `fate` it attaches as it did, and claims all streams.
        """
        chance = self.chance
        if new and fate and chance.random() < 0.1:
            self._instances += 1
        self.claimed = self.writer.streams
        if fate and chance.random() < 0.3:
            names = chance.sample(sorted({name for name, _ in self.writer.streams}), k=1)
            self.claimed = [key for key in self.writer.streams if key[0] in names]
        socket = await self._connect()
        self._note(Sent(json.dumps(self._wanted(f"i{self._instances}"))))
        await socket.send(self.frames[-1].text)
        answer = await self._answer(socket)
        if answer.get("type") != "attached":
            self._refused(answer)
            await socket.close()
            return
        self._socket = socket
        self.attached.set()
        self._detached.clear()
        self.numbers.begin(answer["next"])
        self._reader = asyncio.create_task(self._read(socket))
        self._kept = {seq: event for seq, event in self._kept.items() if seq >= answer["next"]}
        if chance.random() < 0.9:
            await self._resume()

    async def _resume(self) -> None:
        again = [self._kept[seq] for seq in sorted(self._kept)][:_KEPT]
        again = [Event(e.seq, e.stream, e.kind, e.text, (e.stream, e.kind) in self.claimed) for e in again]
        for start in range(0, len(again), 50):
            await self._events(again[start : start + 50], whole=False)

    def _wanted(self, instance: str) -> Frame:
        wanted: Frame = {"type": "attach", "monitor": self.name, "instance": instance, "session": self.session}
        wanted |= {"spec": self.spec, "clock": self.clock, "verdicts": self.chance.random() < 0.5}
        wanted["features"] = ["actions"]
        names = sorted({name for name, _ in self.claimed})
        return wanted | ({} if self.claimed == self.writer.streams else {"streams": names})

    async def _connect(self) -> ClientConnection:
        return await connect(
            self.url, compression=None, proxy=None, ping_interval=None, open_timeout=PATIENCE, max_queue=None,
            max_size=None,
        )  # fmt: skip

    async def _answer(self, socket: ClientConnection) -> Frame:
        answer: Frame = json.loads(await soon(socket.recv()))
        return answer

    def _refused(self, answer: Frame) -> None:
        code = answer.get("code", "")
        self.told.codes[code] += 1
        if code in _OVER:
            self.over = True
        elif code not in ("monitor_taken", "history_unavailable"):
            self.told.wrong.append(f"an attach was answered by {answer}")
            self.over = True

    async def _overtake(self) -> None:
        """Attach from elsewhere in the same process, which ends the connection that stands."""
        before, reader = self._socket, self._reader
        await self._attach(new=False)
        if self._socket is not before and before is not None and reader is not None:
            await soon(reader)
            await before.close()

    async def _intrude(self) -> None:
        """Attach as another process, which is refused while this one is there."""
        socket = await self._connect()
        await socket.send(json.dumps(self._wanted("intruder")))
        with contextlib.suppress(ConnectionClosed):
            answer = await self._answer(socket)
            if answer.get("code") not in ("monitor_taken", *_OVER) and self._reader and not self._reader.done():
                self.told.wrong.append(f"an intruder was answered by {answer}")
        await socket.close()

    async def _vanish(self) -> None:
        """Break the connection without a word."""
        if self._socket is not None:
            self._socket.transport.abort()
        await self._leave()

    async def _leave(self) -> None:
        socket, self._socket = self._socket, None
        reader, self._reader = self._reader, None
        if reader is not None:
            if socket is not None:
                await socket.close()
            await soon(reader)

    # What the server says

    async def _read(self, socket: ClientConnection) -> None:
        upto = 0
        with contextlib.suppress(*LOST):
            async for text in socket:
                frame: dict[str, Any] = json.loads(text)
                if frame["type"] == "ack":
                    if frame["upto"] < upto:
                        self.told.wrong.append(f"acked back from {upto} to {frame['upto']}")
                    upto = frame["upto"]
                    self.numbers.acked = max(self.numbers.acked, upto)
                self._take(frame)

    def _take(self, frame: Frame) -> None:
        match frame:
            case {"type": "decision", "seq": seq}:
                known = self.told.decisions.setdefault((self.name, seq), frame)
                if known != frame:
                    self.told.wrong.append(f"decided differently the second time: {known}, {frame}")
            case {"type": "violation", "n": n}:
                known = self.told.violations.setdefault(n, frame)
                if known != frame:
                    self.told.wrong.append(f"told differently the second time: {known}, {frame}")
            case {"type": "error", "code": code}:
                self.told.codes[code] += 1
                if code == "internal":
                    self.told.wrong.append(f"the server failed: {frame}")
                if "seq" in frame:
                    self.numbers.refused.add(frame["seq"])
                self.over = self.over or code in _OVER
            case {"type": "detached"}:
                self._detached.set()
            case {"type": "ack" | "credit" | "verdicts" | "attached"}:
                pass
            case _:
                self.told.wrong.append(f"the server said {frame}")
