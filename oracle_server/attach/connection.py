"""One WebSocket: the shell around a conversation, which reads, writes and keeps time."""

from __future__ import annotations

import asyncio
from typing import assert_never

import structlog
from starlette.websockets import WebSocket, WebSocketDisconnect

from oracle_server.attach.conversation import MAX_QUEUE, Conversation, Heard
from oracle_server.attach.patience import Patience
from oracle_server.attach.throttle import Throttle
from oracle_server.core.errors import HistoryError
from oracle_server.edge.access import grant_of
from oracle_server.edge.transport import DIRECT, WebSocketTransport
from oracle_server.sessions.greeting import attached_frame
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.monitor import Monitor
from oracle_server.sessions.registry import Registry
from oracle_server.wire.errors import WireError
from oracle_server.wire.frames import Outgoing
from oracle_server.wire.incoming import (
    SUBPROTOCOL,
    Attach,
    ClockMessage,
    Detach,
    EventMessage,
    HandlingMessage,
    HandlingsMessage,
    QuickClock,
    QuickEvent,
    QuickHandlings,
    ReportMessage,
)
from oracle_server.wire.json import encode, encode_bytes

_ATTACH_WITHIN = 10.0
"""Seconds for the first frame to come."""
_ANSWER_WITHIN = 8.0
"""Seconds to open and commit what `attach` wants: an adapter waits for 10 s."""
_STALLED = 5.0
"""Seconds for which a monitor may take no frame, or leave too many."""
_CLOSE_WITHIN = 5.0
"""Seconds for the last frames to be taken."""
_BATCH = '{"type":"events"'
"""How a batch begins, mostly: it is taken in turns."""

log = structlog.get_logger()


class Connection:
    """Serves one WebSocket until it ends."""

    def __init__(self, socket: WebSocket, registry: Registry, max_rate: float = 0) -> None:
        """Serve a socket whose monitor may send `max_rate` events a second on average; 0 for any number."""
        self._socket, self._registry = socket, registry
        self._talk = Conversation()
        self._place: tuple[LiveSession, Monitor] | None = None
        self._throttle = Throttle(max_rate)
        self._ready = asyncio.Event()  # there is something to write
        self._over = asyncio.Event()
        self._sending = asyncio.Lock()
        self._taking = False  # what is sent now is written with the rest, once all is taken
        self._direct: WebSocketTransport | None = socket.scope.get("extensions", {}).get(DIRECT)
        self._idle = False  # the reader waits for a frame
        self._owed = 0.0  # seconds that it is to rest before the next one
        self._backlog: asyncio.TimerHandle | None = None
        self._stalled = Patience(_STALLED, self._give_up)
        self._tasks: list[asyncio.Task[None]] = []

    # For the session

    def send(self, frame: Outgoing) -> None:
        """Queue a frame."""
        self._talk.send(frame)
        if not self._taking:
            self._ready.set()
        if len(self._talk.queue) > MAX_QUEUE and self._backlog is None:
            self._backlog = asyncio.get_running_loop().call_later(_STALLED, self._look_again)

    def drop(self, reason: WireError) -> None:
        """Send an error after what is queued, and close."""
        self._talk.drop(reason)
        self._ready.set()

    def finish(self, frame: Outgoing) -> None:
        """Send a last frame after what is queued, and close."""
        self._talk.finish(frame)
        self._ready.set()

    async def sent(self) -> None:
        """Wait until the last frame was sent, or can't be any more."""
        await self._over.wait()

    @property
    def queued(self) -> int:
        """Frames that wait for the monitor to read them."""
        return len(self._talk.queue)

    # Its life

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
            if self._backlog is not None:
                self._backlog.cancel()
            if self._direct is not None:
                self._direct.taker = None
            if self._place is not None:
                session, monitor = self._place
                _, reason = self._talk.end
                log.info("monitor gone", session=session.id, monitor=monitor.name, reason=reason or "left")
                session.disconnected(monitor, self)

    def _give_up(self) -> None:
        for task in self._tasks:
            task.cancel()

    def _look_again(self) -> None:
        self._backlog = None
        self._talk.cut_off_crowded()
        self._ready.set()

    def _fail(self) -> None:
        log.exception("a connection failed")
        self.drop(WireError("internal", "the server failed; its log says why", fatal=True))

    # Writing

    async def _write(self) -> None:
        """Send what is queued, and close once the end of the queue is the end of the connection."""
        try:
            while not self._talk.ended or self._talk.queue:
                await self._ready.wait()
                self._ready.clear()
                await self._send_queued()
            await self._socket.close(*self._talk.end)
        except (WebSocketDisconnect, RuntimeError, OSError):
            return
        finally:
            self._over.set()

    async def _send_queued(self) -> None:
        """Send what is queued; the peer must take each frame within `_STALLED`, but for the last ones."""
        async with self._sending:
            while (frame := self._talk.next_frame()) is not None:
                if not self._talk.ended:
                    self._stalled.begin()
                await self._socket.send_text(encode(frame))
                self._stalled.end()

    async def _answer(self) -> None:
        """Send at once what a frame was answered with: waking the writer for it would take longer than the judging."""
        if not self._talk.queue:
            return
        if self._sending.locked():
            self._ready.set()
            return
        try:
            await self._send_queued()
        except (RuntimeError, OSError):
            raise WebSocketDisconnect(1006) from None

    # Reading

    async def _read(self) -> None:
        try:
            await self._attach()
            while self._place is not None and not self._talk.ended:
                session, _ = self._place
                await session.room()
                data = await self._next()
                if self._owed:
                    await asyncio.sleep(self._owed)
                    self._owed = 0.0
                self._hear(data)
                await self._answer()
                while self._throttle.is_due:
                    await asyncio.sleep(self._pause())  # others take their turn
                    self._take_some()
                    await self._answer()
        except WireError as error:
            self.drop(error)
        except WebSocketDisconnect:
            self._talk.lost()
        except Exception:  # noqa: BLE001 -- whatever it is, the others go on
            self._fail()
        finally:
            self._ready.set()

    async def _attach(self) -> None:
        """Wait for `attach`, and answer it. Raises a fatal `WireError` where it can't be done in time."""
        try:
            async with asyncio.timeout(_ATTACH_WITHIN):
                data = await self._receive()
        except TimeoutError:
            raise WireError("bad_attach", f"no `attach` within {_ATTACH_WITHIN:.0f} s", fatal=True) from None
        self._talk.receive(data)
        wanted = self._talk.next_message()
        if not isinstance(wanted, Attach):
            return
        self._check_grant(wanted)
        try:
            async with asyncio.timeout(_ANSWER_WITHIN):
                session, monitor = self._place = await self._registry.attach(wanted, self)
                self._registry.counters.attachments += 1
                log.info("monitor attached", session=session.id, monitor=monitor.name)
                await self._registry.flush()  # a monitor that is greeted is waited for by a restarted server
        except TimeoutError:
            message = f"the history did not take the session within {_ANSWER_WITHIN:.0f} s; attach again later"
            raise WireError("history_unavailable", message, fatal=True) from None
        except HistoryError as error:
            raise WireError("history_unavailable", f"{error}; attach again later", fatal=True) from None
        if self._talk.ended:
            return
        self._talk.greet(attached_frame(session, monitor), monitor.numbering.upto)
        session.send_verdicts(monitor)
        self._ready.set()
        if self._direct is not None:
            self._direct.taker = self

    def _check_grant(self, wanted: Attach) -> None:
        live = self._registry.open.get(wanted.session or "")
        spec = live.spec.id if live else wanted.spec
        if not grant_of(self._socket).covers(spec=spec, session=wanted.session):
            raise WireError("forbidden", "the token is bound to other specs or sessions", fatal=True)

    async def _next(self) -> str | bytes:
        """The next frame that was not taken as it came."""
        self._idle = True
        try:
            return await self._receive()
        finally:
            self._idle = False

    async def _receive(self) -> str | bytes:
        message = await self._socket.receive()
        if message["type"] == "websocket.disconnect":
            raise WebSocketDisconnect(message.get("code", 1006))
        text: str | None = message.get("text")
        return message.get("bytes") or b"" if text is None else text

    def take(self, text: str) -> bool:
        """Take a frame as it comes: waking the reader for it would take longer than the judging."""
        if self._place is None or not self._place[0].has_room:
            return False
        waits = not self._idle or self._owed or self._throttle.is_long
        if waits or self._talk.ended or text.startswith(_BATCH):
            return False
        try:
            return self._hear(text, batches=False)
        except Exception:  # noqa: BLE001 -- whatever it is, the others go on
            self._fail()
            return True

    def taken(self) -> None:
        """Send what was answered, and rest where this monitor is too fast."""
        if self._idle:
            self._owed = self._pause()
        if self._talk.queue and not self._talk.ended and self._direct is not None:
            if not self._sending.locked() and self._direct.write([encode_bytes(frame) for frame in self._talk.queue]):
                self._talk.written()
            else:
                self._ready.set()

    def _pause(self) -> float:
        """Seconds to rest, for a monitor that is too fast."""
        pause = self._throttle.pause()
        if pause:
            self._registry.counters.throttled += 1
            self._talk.throttle()
            self._ready.set()
        return pause

    # Taking

    def _hear(self, data: str | bytes, *, batches: bool = True) -> bool:
        """Take a frame; False for a batch where these are not wanted."""
        self._throttle.count()
        if not self._talk.receive(data, batches=batches):
            return False
        self._take_some()
        return True

    def _take_some(self) -> None:
        """Take what was received, until it is at its end or others are to take their turn."""
        assert self._place is not None  # noqa: S101 -- only called once attached
        session, monitor = self._place
        talk, throttle = self._talk, self._throttle
        self._taking = True
        try:
            while (message := talk.next_message()) is not None:
                try:
                    _hand_over(message, session, monitor)
                except WireError as error:
                    talk.refuse(error)
                if not talk.in_batch:
                    break
                throttle.count()
                if throttle.is_due:
                    break
        finally:
            self._taking = False
            if talk.ended:
                self._ready.set()


def _hand_over(message: Heard, session: LiveSession, monitor: Monitor) -> None:
    """Give a monitor's message to its session. Raises `WireError` where it is refused."""
    match message:
        case QuickEvent() | EventMessage():
            session.ingest(monitor, message)
        case WireError():
            session.refuse(monitor, message)
        case QuickClock() | ClockMessage():
            session.update_clocks(monitor, message)
        case HandlingMessage():
            session.record_handling(monitor, message)
        case QuickHandlings(outcomes=outcomes) | HandlingsMessage(outcomes=outcomes):
            for outcome in outcomes:
                session.record_handling(monitor, outcome)
        case ReportMessage():
            session.report(monitor, message)
        case Detach():
            session.detach(monitor)
        case Attach():
            pass  # only as the first frame, which `_attach` takes
        case _:
            assert_never(message)
