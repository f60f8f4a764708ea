"""One WebSocket: frames in, to its session; frames out, from a bounded queue."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Iterator
from typing import Any

import structlog
from starlette.websockets import WebSocket, WebSocketDisconnect

from oracle_server.attach.patience import Patience
from oracle_server.attach.throttle import Throttle
from oracle_server.edge.access import grant_of
from oracle_server.edge.transport import DIRECT, WebSocketTransport
from oracle_server.history.port import Writing
from oracle_server.sessions.greeting import attached_frame
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.monitor import Monitor
from oracle_server.sessions.registry import Registry
from oracle_server.wire.errors import WireError
from oracle_server.wire.incoming import (
    SUBPROTOCOL,
    Attach,
    ClockMessage,
    Detach,
    Events,
    HandlingMessage,
    HandlingsMessage,
    QuickClock,
    QuickEvent,
    QuickEvents,
    QuickHandlings,
    ReportMessage,
)
from oracle_server.wire.json import encode, encode_bytes
from oracle_server.wire.reading import Frame, decode, event_of

MAX_QUEUE = 10_000
"""Frames that may wait for a monitor for longer than `_STALLED`; beyond, it is cut off, and resumes by itself."""
MAX_BURST = 50_000
"""Frames that may wait at any time: what was held up may be judged, and told, all at once."""
_STALLED = 5.0
_ATTACH_WITHIN = 10.0
_CLOSE_WITHIN = 5.0

_BATCH = '{"type":"events"'
"""How a batch begins, mostly: it is taken in turns."""

log = structlog.get_logger()


class Connection:
    """Serves one WebSocket until it ends."""

    def __init__(self, socket: WebSocket, registry: Registry, store: Writing, max_rate: float = 0) -> None:
        """Serve a socket whose monitor may send `max_rate` events a second on average; 0 for any number."""
        self._socket, self._registry, self._store = socket, registry, store
        self._throttle, self._throttled = Throttle(max_rate), False
        self._batch: Iterator[Any] = iter(())
        self._suspicious = False
        self._queue: deque[dict[str, Any]] = deque()
        self._ready = asyncio.Event()
        self._end: tuple[int, str] | None = None
        self._greeted = asyncio.Event()
        self._over = asyncio.Event()
        self._sending = asyncio.Lock()
        self._taking = False
        self._direct: WebSocketTransport | None = socket.scope.get("extensions", {}).get(DIRECT)
        self._idle = False  # the reader waits for a frame
        self._owed = 0.0  # seconds that it is to rest before the next one
        self._backlog: asyncio.TimerHandle | None = None
        self._stalled = Patience(_STALLED, self._give_up)
        self._tasks: list[asyncio.Task[None]] = []
        self._session: LiveSession | None = None
        self._monitor: Monitor | None = None

    def send(self, frame: dict[str, Any]) -> None:
        """Queue a frame; an ack replaces one that waits at the end of the queue."""
        if self._end is not None:
            return
        if frame["type"] == "ack" and self._queue and self._queue[-1]["type"] == "ack":
            self._queue.pop()
        self._queue.append(frame)
        if not self._taking:
            self._ready.set()
        if len(self._queue) > MAX_BURST:
            self._cut_off()
        elif len(self._queue) > MAX_QUEUE and self._backlog is None:
            self._backlog = asyncio.get_running_loop().call_later(_STALLED, self._look_again)

    @property
    def queued(self) -> int:
        """Frames that wait for the monitor to read them."""
        return len(self._queue)

    def _look_again(self) -> None:
        self._backlog = None
        if len(self._queue) > MAX_QUEUE:
            self._cut_off()

    def _cut_off(self) -> None:
        self._queue.clear()
        self.drop(WireError("too_slow", f"more than {MAX_QUEUE} frames were not read; attach again", fatal=True))

    def drop(self, reason: WireError) -> None:
        """Send an error after what is queued, and close."""
        self.finish(reason.frame(), 1012 if reason.code == "shutting_down" else 1008, reason.code)

    def finish(self, frame: dict[str, Any], code: int = 1000, reason: str = "") -> None:
        """Send a last frame after what is queued, and close."""
        if self._end is None:
            if not self._greeted.is_set():
                self._queue.clear()  # the peer knows of nothing yet
            self._queue.append(frame)
            self._end = (code, reason)
            self._greeted.set()
            self._ready.set()

    async def sent(self) -> None:
        """Wait until the last frame was sent, or can't be any more."""
        await self._over.wait()

    async def serve(self) -> None:
        """Accept the connection and serve it until either side ends it."""
        offered = self._socket.scope.get("subprotocols", [])
        await self._socket.accept(SUBPROTOCOL if SUBPROTOCOL in offered else None)
        try:
            async with asyncio.TaskGroup() as tasks:
                writer = tasks.create_task(self._write())
                reader = tasks.create_task(self._read())
                self._tasks = [writer, reader]
                await asyncio.wait((writer, reader), return_when=asyncio.FIRST_COMPLETED)
                if reader.done() and not writer.done():
                    await asyncio.wait((writer,), timeout=_CLOSE_WITHIN)
                self._give_up()
        finally:
            self._stalled.stop()
            if self._direct is not None:
                self._direct.taker = None
            if self._session and self._monitor:
                reason = self._end[1] if self._end else ""
                log.info("monitor gone", session=self._session.id, monitor=self._monitor.name, reason=reason or "left")
                self._session.disconnected(self._monitor, self)

    def _give_up(self) -> None:
        for task in self._tasks:
            task.cancel()

    async def _write(self) -> None:
        """Send what is queued, and close once the end of the queue is the end of the connection."""
        await self._greeted.wait()
        try:
            while self._end is None or self._queue:
                await self._ready.wait()
                self._ready.clear()
                await self._send_queued()
            await self._socket.close(*self._end)
        except (WebSocketDisconnect, RuntimeError, OSError):
            return
        finally:
            self._over.set()

    async def _send_queued(self) -> None:
        """Send what is queued; the peer must take each frame within `_STALLED`, but for the last ones."""
        async with self._sending:
            while self._queue:
                text = encode(self._queue.popleft())
                if self._end is None:
                    self._stalled.begin()
                await self._socket.send_text(text)
                self._stalled.end()

    async def _read(self) -> None:
        try:
            async with asyncio.timeout(_ATTACH_WITHIN):
                text = await self._receive()
            await self._attach(text)
            while self._end is None:
                await self._store.room()
                text = await self._next()
                if self._owed:
                    await asyncio.sleep(self._owed)
                    self._owed = 0.0
                self._take(text)
                await self._answer()
                while self._throttle.is_due:
                    await self._rest()
                    self._take_some()
                    await self._answer()
        except WireError as error:
            self.drop(error)
        except TimeoutError:
            self.drop(WireError("bad_attach", f"no `attach` within {_ATTACH_WITHIN:.0f} s", fatal=True))
        except WebSocketDisconnect:
            self._queue.clear()
            self._end = self._end or (1000, "")
            self._greeted.set()
            self._ready.set()
        except Exception:  # noqa: BLE001 -- whatever it is, the others go on
            self._fail()

    async def _next(self) -> str:
        """The next frame that was not taken as it came."""
        self._idle = True
        try:
            return await self._receive()
        finally:
            self._idle = False

    def take(self, text: str) -> bool:
        """Take a frame as it comes: waking the reader for it would take longer than the judging."""
        waits = not self._idle or self._owed or self._throttle.is_long or not self._store.has_room
        if waits or self._end is not None or text.startswith(_BATCH):
            return False
        try:
            return self._take(text, batches=False)
        except Exception:  # noqa: BLE001 -- whatever it is, the others go on
            self._fail()
            return True

    def taken(self) -> None:
        """Send what was answered, and rest where this monitor is too fast."""
        if self._idle:
            self._owed = self._pause()
        if self._queue and self._end is None and self._direct is not None:
            if not self._sending.locked() and self._direct.write([encode_bytes(frame) for frame in self._queue]):
                self._queue.clear()
            else:
                self._ready.set()

    def _fail(self) -> None:
        log.exception("a connection failed")
        self.drop(WireError("internal", "the server failed; its log says why", fatal=True))

    async def _answer(self) -> None:
        """Send at once what a frame was answered with: waking the writer for it would take longer than the judging."""
        if not self._queue:
            return
        if self._sending.locked():
            self._ready.set()
            return
        try:
            await self._send_queued()
        except (RuntimeError, OSError):
            raise WebSocketDisconnect(1006) from None

    async def _receive(self) -> str:
        message = await self._socket.receive()
        if message["type"] == "websocket.disconnect":
            raise WebSocketDisconnect(message.get("code", 1006))
        text = message.get("text")
        if text is None:
            raise WireError("malformed", "frames are text, not bytes", fatal=True)
        return str(text)

    async def _attach(self, text: str) -> None:
        try:
            wanted = decode(text).message
        except WireError as error:
            raise WireError("bad_attach", error.message, fatal=True) from None
        if not isinstance(wanted, Attach):
            raise WireError("bad_attach", "the first frame must be `attach`", fatal=True)
        self._check_grant(wanted)
        self._session, self._monitor = await self._registry.attach(wanted, self)
        self._registry.counters.opened += 1
        log.info("monitor attached", session=self._session.id, monitor=self._monitor.name)
        await self._store.flush()  # once it is told, a restarted server must know that it is waited for
        if self._end is not None:
            return
        # before anything that was queued since: the monitor knows nothing yet
        self._queue.appendleft(attached_frame(self._session, self._monitor))
        self._greeted.set()
        self._ready.set()
        if self._monitor.numbering.upto:
            self.send({"type": "ack", "upto": self._monitor.numbering.upto})
        self._session.tell_verdicts(self._monitor)
        if self._direct is not None:
            self._direct.taker = self

    def _check_grant(self, wanted: Attach) -> None:
        live = self._registry.open.get(wanted.session or "")
        spec = live.spec.id if live else wanted.spec
        if not grant_of(self._socket).covers(spec=spec, session=wanted.session):
            raise WireError("forbidden", "the token is bound to other specs or sessions", fatal=True)

    def _take(self, text: str, *, batches: bool = True) -> bool:
        """Take a frame; False for a batch where these are not wanted."""
        assert self._session is not None  # noqa: S101 -- only called once attached
        assert self._monitor is not None  # noqa: S101
        if self._monitor.outbox is not self:
            return True
        if self._monitor.detaching:
            self.send(WireError("detached", "the monitor has detached; what it says now is not heard").frame())
            return True
        self._taking = True
        self._throttle.count()
        try:
            frame = decode(text)
            if not batches and isinstance(frame.message, Events | QuickEvents):
                return False
            self._dispatch(frame, self._session, self._monitor)
        except WireError as error:
            self._refuse(error)
        finally:
            self._taking = False
        return True

    def _take_some(self) -> None:
        """Go on with a batch, until it is at its end or it is the others' turn."""
        assert self._session is not None  # noqa: S101 -- only called once attached
        assert self._monitor is not None  # noqa: S101
        if self._monitor.outbox is not self:
            return
        self._taking = True
        for value in self._batch:
            try:
                event = value if type(value) is QuickEvent else event_of(value, suspicious=self._suspicious)
                self._session.ingest(self._monitor, event)
            except WireError as error:
                self._refuse(error)
            self._throttle.count()
            if self._throttle.is_due:
                break
        self._taking = False

    async def _rest(self) -> None:
        """Let the others have their turn, and a longer one where this monitor is too fast."""
        await asyncio.sleep(self._pause())

    def _pause(self) -> float:
        pause = self._throttle.pause()
        self._registry.counters.throttled += pause > 0
        if pause and not self._throttled:
            self._throttled = True
            self.send(WireError("throttled", "more events than may come; the rest is read more slowly").frame())
        return pause

    def _dispatch(self, frame: Frame, session: LiveSession, monitor: Monitor) -> None:
        match frame.message:
            case Attach():
                raise WireError("bad_attach", "attached already")
            case HandlingMessage() as message:
                session.outcome(monitor, message)
            case HandlingsMessage(outcomes=outcomes) | QuickHandlings(outcomes=outcomes):
                for outcome in outcomes:
                    session.outcome(monitor, outcome)
            case ClockMessage() | QuickClock() as message:
                session.clock(monitor, message)
            case ReportMessage() as message:
                session.report(monitor, message)
            case Detach():
                session.detach(monitor)
            case Events(events=events) | QuickEvents(events=events):
                self._batch, self._suspicious = iter(events), frame.suspicious
                self._take_some()
            case message:
                session.ingest(monitor, message)

    def _refuse(self, error: WireError) -> None:
        assert self._session is not None  # noqa: S101 -- only called once attached
        assert self._monitor is not None  # noqa: S101
        if error.code == "bad_event":
            self._session.refuse(self._monitor, error)
        self.send(error.frame())
