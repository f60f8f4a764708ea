"""One monitor's WebSocket: it reads and writes the frames of a conversation, and enforces the timeouts."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable

import structlog
from starlette.websockets import WebSocket, WebSocketDisconnect

from oracle_server.attach.conversation import MAX_QUEUE, Conversation
from oracle_server.attach.dispatch import data_of, dispatch
from oracle_server.attach.throttle import Throttle
from oracle_server.attach.timeout import ReusableTimeout
from oracle_server.core.errors import HistoryError
from oracle_server.core.weakly import weakly
from oracle_server.edge.access import grant_of
from oracle_server.edge.transport import DIRECT, WebSocketTransport
from oracle_server.process.shortage import shortage
from oracle_server.sessions.greeting import attached_frame
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.monitor import Monitor
from oracle_server.sessions.registry import Registry
from oracle_server.wire.errors import WireError
from oracle_server.wire.frames import Outgoing
from oracle_server.wire.incoming import SUBPROTOCOL, Attach
from oracle_server.wire.json import encode, encode_bytes

_ATTACH_WITHIN = 10.0
"""Seconds for the first frame to arrive."""
_ANSWER_WITHIN = 8.0
"""Seconds to open and commit the session of an `attach`: an adapter waits for 10 s."""
_STALLED = 5.0
"""Seconds for which a monitor may read no frame, or leave too many unread."""
_CLOSE_WITHIN = 5.0
"""Seconds for the monitor to read the last frames."""
_BATCH = '{"type":"events"'
"""How most batches begin; they are left to the reader, which yields to other connections."""

log = structlog.get_logger()


class Connection:
    """Serves one WebSocket until it ends."""

    def __init__(self, socket: WebSocket, registry: Registry, max_rate: float = 0) -> None:
        """Serve a socket whose monitor may send `max_rate` events a second on average; 0 is no limit."""
        self._socket, self._registry = socket, registry
        self._conversation = Conversation()
        self._attached: tuple[LiveSession, Monitor] | None = None
        self._throttle = Throttle(max_rate)
        self._ready = asyncio.Event()  # frames wait, or the conversation has ended
        self._closed = asyncio.Event()
        self._sending = asyncio.Lock()
        self._processing = False  # frames that are queued meanwhile are written together afterwards
        self._direct: WebSocketTransport | None = socket.scope.get("extensions", {}).get(DIRECT)
        self._idle = False  # the reader waits for a frame
        self._due_pause = 0.0  # seconds to wait before the next frame is processed
        self._backlog: asyncio.TimerHandle | None = None
        self._stalled = ReusableTimeout(_STALLED, weakly(self._give_up))
        self._tasks: list[asyncio.Task[None]] = []

    # For the session

    def send(self, frame: Outgoing) -> None:
        """Queue a frame."""
        self._conversation.send(frame)
        if not self._processing:
            self._ready.set()
        if len(self._conversation.queue) > MAX_QUEUE and self._backlog is None:
            self._backlog = asyncio.get_running_loop().call_later(_STALLED, self._check_backlog)

    def drop(self, reason: WireError) -> None:
        """Send an error after what is queued, and close."""
        self._conversation.drop(reason)
        self._ready.set()

    def finish(self, frame: Outgoing) -> None:
        """Send a last frame after what is queued, and close."""
        self._conversation.finish(frame)
        self._ready.set()

    async def sent(self) -> None:
        """Wait until the last frame was sent, or the connection is lost."""
        await self._closed.wait()

    async def reached(self) -> bool:
        """Whether the monitor answers within `_STALLED` seconds."""
        return self._direct is None or await self._direct.reached(_STALLED)

    @property
    def queued(self) -> int:
        """The number of frames that wait to be written."""
        return len(self._conversation.queue)

    # Lifetime

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
                if reader.done():
                    await asyncio.wait((writer,), timeout=_CLOSE_WITHIN)
                elif not self._conversation.ended:  # the connection is lost, and what had come before is still taken
                    await asyncio.wait((reader,), timeout=_CLOSE_WITHIN)
                self._give_up()
        finally:
            self._stalled.stop()
            if self._backlog is not None:
                self._backlog.cancel()
            if self._direct is not None:
                self._direct.receiver = None
            if self._attached is not None:
                session, monitor = self._attached
                _, reason = self._conversation.end
                log.info("monitor disconnected", session=session.id, monitor=monitor.name, reason=reason or "left")
                session.disconnected(monitor, self)

    def _give_up(self) -> None:
        for task in self._tasks:
            task.cancel()

    def _check_backlog(self) -> None:
        self._backlog = None
        self._conversation.cut_off_crowded()
        self._ready.set()

    def _fail(self, error: Exception) -> None:
        if short := shortage(error):
            log.error("a connection failed", reason=short)
        else:
            log.error("a connection failed", exc_info=error)
        self.drop(WireError("internal", f"the server failed: {short or 'see its log'}", fatal=True))

    # Writing

    async def _write(self) -> None:
        """Write queued frames until the conversation has ended and all are written, then close."""
        try:
            while not self._conversation.ended or self._conversation.queue:
                await self._ready.wait()
                self._ready.clear()
                await self._send_queued()
            await self._socket.close(*self._conversation.end)
        except (WebSocketDisconnect, RuntimeError, OSError):
            return
        finally:
            self._closed.set()

    async def _send_queued(self) -> None:
        """Write queued frames; before the end, the connection is given up where one takes longer than `_STALLED`."""
        async with self._sending:
            while (frame := self._conversation.next_frame()) is not None:
                if not self._conversation.ended:
                    self._stalled.begin()
                await self._socket.send_text(encode(frame))
                self._stalled.end()

    async def _send_replies(self) -> None:
        """Write replies directly: waking the writer would take longer than judging."""
        if not self._conversation.queue:
            return
        if self._sending.locked():
            self._ready.set()
            return
        with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):  # the reader is told after what had come
            await self._send_queued()

    # Reading

    async def _read(self) -> None:
        try:
            await self._attach()
            while self._attached is not None and not self._conversation.ended:
                session, _ = self._attached
                await session.keeping.room()
                data = await self._next()
                if self._due_pause:
                    await asyncio.sleep(self._due_pause)
                    self._due_pause = 0.0
                await session.share.rested()
                await session.caught_up()
                session.share.run(self._process_frames, data)
                await self._send_replies()
                while self._conversation.in_batch:
                    await asyncio.sleep(self._pause())  # yields even for 0 s
                    await session.share.rested()
                    await session.caught_up()
                    session.share.run(self._process_messages)
                    await self._send_replies()
        except WireError as error:
            self.drop(error)
        except WebSocketDisconnect:
            self._conversation.lost()
        except Exception as error:  # noqa: BLE001 -- no other connection may be affected
            self._fail(error)
        finally:
            self._ready.set()

    async def _attach(self) -> None:
        """Receive `attach`, and answer it. Raises a fatal `WireError` where it is refused, or takes too long."""
        try:
            async with asyncio.timeout(_ATTACH_WITHIN):
                data = data_of(await self._socket.receive())
        except TimeoutError:
            raise WireError("bad_attach", f"no `attach` within {_ATTACH_WITHIN:.0f} s", fatal=True) from None
        self._conversation.receive(data)
        wanted = self._conversation.next_message()
        if not isinstance(wanted, Attach):
            return
        try:
            async with asyncio.timeout(_ANSWER_WITHIN):
                await self._check_grant(wanted)
                session, monitor = self._attached = await self._registry.attach(wanted, self)
                self._registry.counters.attachments += 1
                log.info("monitor attached", session=session.id, monitor=monitor.name)
                await self._registry.flush()  # after a restart, the server waits for all monitors that were greeted
                session.keeping.check()
        except TimeoutError:
            message = f"the session was not committed within {_ANSWER_WITHIN:.0f} s; attach again later"
            raise WireError("history_unavailable", message, fatal=True) from None
        except WireError as error:
            if error.code == "spec_mismatch":  # perhaps with a spec that the token may not know, opened meanwhile
                await self._check_grant(wanted)
            if error.code == "unknown_spec" and wanted.spec is not None and grant_of(self._socket).bound:
                raise WireError(error.code, f"there is no spec '{wanted.spec}'", fatal=True) from None
            raise
        except HistoryError as error:
            raise WireError("history_unavailable", f"{error}; attach again later", fatal=True) from None
        if self._conversation.ended:
            return
        self._conversation.decoders = session.decoder
        self._conversation.greet(attached_frame(session, monitor), monitor.numbering.upto)
        session.ledger.send_verdicts(monitor)
        self._ready.set()
        if self._direct is not None:
            self._direct.receiver = self

    async def _check_grant(self, wanted: Attach) -> None:
        """Raise a fatal `WireError` where the token does not cover a session, be it open, closed or new."""
        grant = grant_of(self._socket)
        if not grant.bound:
            return
        known = await self._registry.known(wanted.session) if wanted.session is not None else None
        spec = known.spec if known else wanted.spec
        if not grant.covers(spec=spec, session=wanted.session):
            raise WireError("forbidden", "the token is bound to other specs or sessions", fatal=True)

    async def _next(self) -> str | bytes:
        """Receive the next frame that `offer` has declined."""
        self._idle = True  # also while others are served: else all frames would come here once one has
        try:
            if self._throttle.must_yield:
                self._due_pause = self._pause()
                await asyncio.sleep(0)  # the turn of others
            return data_of(await self._socket.receive())
        finally:
            self._idle = False

    def offer(self, text: str) -> bool:
        """Process a frame on its arrival, since waking the reader would take longer than judging.

        Returns False where the frame must wait for the reader.
        """
        if self._attached is None:
            return False
        session, _ = self._attached
        if not session.keeping.has_room or session.share.rest or session.is_behind:
            return False
        waits = not self._idle or self._due_pause or self._throttle.must_yield
        if waits or self._conversation.ended or text.startswith(_BATCH):
            return False
        try:
            return self._process_frame(text, batches=False)
        except Exception as error:  # noqa: BLE001 -- no other connection may be affected
            self._fail(error)
            return True

    @property
    def rest(self) -> float:
        """For how many seconds nothing more should be read from the socket."""
        return 0.0 if self._attached is None else self._attached[0].share.rest

    def take(self, work: Callable[[], None]) -> None:
        """Let data from the socket be processed, and charge the session for it."""
        assert self._attached is not None  # noqa: S101 -- only called once attached
        self._throttle.begin()
        self._attached[0].share.run(self._take, work)

    def _take(self, work: Callable[[], None]) -> None:
        work()
        self._flush()

    def _flush(self) -> None:
        """Write the replies to the frames that were processed on arrival, and note for how long to pause."""
        if self._idle:
            self._due_pause = self._pause()
        queue = self._conversation.queue
        if queue and not self._conversation.ended and self._direct is not None:
            if not self._sending.locked() and self._direct.write([encode_bytes(frame) for frame in queue]):
                self._conversation.written()
            else:
                self._ready.set()

    def _pause(self) -> float:
        """Seconds to pause before more is read, where the monitor sends too fast."""
        pause = self._throttle.pause()
        if pause:
            self._registry.counters.throttled += 1
            self._conversation.throttle()
            self._ready.set()
        return pause

    # Processing

    def _process_frames(self, data: str | bytes) -> None:
        """Process a frame and those that wait behind it, until its batch or others should be gone on with."""
        assert self._attached is not None  # noqa: S101 -- only called once attached
        session, conversation = self._attached[0], self._conversation
        self._process_frame(data)
        while not (conversation.in_batch or conversation.ended or self._throttle.must_yield or session.is_behind):
            message = self._direct.receive_waiting() if self._direct is not None and session.keeping.has_room else None
            if message is None:
                return
            self._process_frame(data_of(message))

    def _process_frame(self, data: str | bytes, *, batches: bool = True) -> bool:
        """Process a frame; False for a batch where `batches` is False."""
        self._throttle.count()
        if not self._conversation.receive(data, batches=batches):
            return False
        self._process_messages()
        return True

    def _process_messages(self) -> None:
        """Process the messages of the received frame, until its end or until other connections are due."""
        assert self._attached is not None  # noqa: S101 -- only called once attached
        session, monitor = self._attached
        conversation, throttle = self._conversation, self._throttle
        self._processing = True
        try:
            while (message := conversation.next_message()) is not None:
                try:
                    dispatch(message, session, monitor)
                except WireError as error:
                    conversation.refuse(error)
                if not conversation.in_batch:
                    break
                throttle.count()
                if throttle.must_yield or session.is_behind:
                    break
        finally:
            self._processing = False
            if conversation.ended:
                self._ready.set()
