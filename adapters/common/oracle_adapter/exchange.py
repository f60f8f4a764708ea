"""The protocol's state shared by threads: one lock around it, callbacks for answers and notices.

Robot threads put events in and never wait; the link's own thread writes and reads frames, and calls
the callbacks. None is called under the lock.
"""

from __future__ import annotations

import asyncio
import threading
from operator import index
from typing import TYPE_CHECKING, Any, Callable, Dict, Literal, Optional, Union

from oracle_adapter import logs
from oracle_adapter.deadlines import Deadlines
from oracle_adapter.decision import Answer
from oracle_adapter.errors import LinkError
from oracle_adapter.notices import Answered, Attached, Episode, Revision, Room, Verdicts, Violation
from oracle_adapter.protocol import Protocol

if TYPE_CHECKING:
    from typing import Iterable, List, Mapping, Tuple

    from oracle_adapter.decision import Why
    from oracle_adapter.marks import ClockStamp
    from oracle_adapter.notices import Notice
    from oracle_adapter.queued import Queued
    from oracle_adapter.stats import Stats

State = Literal["attached", "disconnected", "ended"]
Stamp = Union[int, None, Callable[[], Optional[int]]]
"""Publication time (ns), None where there is none, or a function that is called under the lock."""
Then = Callable[[Answer], None]
"""What is done with the answer to an ask, mostly in the link's thread."""

HANDLINGS_AFTER = 0.003
"""Seconds in which handlings are gathered: many in a frame cost little more than one."""


class Exchange:
    """What `Link` does, but for the connection."""

    def __init__(
        self,
        protocol: Protocol,
        on_violation: Optional[Callable[[Mapping[str, Any]], None]],
        on_state: Optional[Callable[[State, str], None]],
        on_error: Optional[Callable[[LinkError], None]],
        on_verdicts: Optional[Callable[[Mapping[str, Any]], None]] = None,
        on_revision: Optional[Callable[[Mapping[str, Any]], None]] = None,
        on_episode: Optional[Callable[[Mapping[str, Any]], None]] = None,
    ) -> None:
        self._on_violation, self._on_state, self._on_error = on_violation, on_state, on_error
        self._on_verdicts, self._on_revision = on_verdicts, on_revision
        self._on_episode = on_episode
        self._lock = threading.Lock()  # guards all that follows
        self._changed = threading.Condition(self._lock)  # opened, attached or ended
        self._protocol = protocol
        self._asks: Dict[int, Tuple[Queued, Then]] = {}
        self._handlings: List[Tuple[Answer, bool, Why]] = []
        self._deadlines = Deadlines()
        self._timer: Optional[asyncio.TimerHandle] = None
        self._loop: Optional[asyncio.AbstractEventLoop] = None
        self._pump: Callable[[], None] = _nothing
        self._thread = 0
        self._opened = False  # the link's thread has been ready
        self._awake = False  # the queue will be looked at
        self._trouble: Optional[LinkError] = None  # why there is no connection
        self._refusal = ""  # how the last attempt to attach was answered
        self._at_once: Optional[Callable[[], None]] = None
        self._later: Optional[Callable[[], None]] = None

    def judge_at_once(self, now: Callable[[], None], later: Callable[[], None]) -> None:
        """Call `now` in the threads that ask or bring clocks, without the lock.

        `later` is called in whatever thread, under the lock, for all else; it must not wait.
        """
        self._at_once, self._later = now, later

    # From robot threads

    def wait_opened(self, timeout: float) -> None:
        """Wait up to `timeout` seconds for the link's thread; raises `LinkError` without it."""
        with self._changed:
            self._changed.wait_for(lambda: self._opened or self._protocol.ended, timeout)
            if self._opened:
                return
            if self._protocol.ended is not None:
                raise self._protocol.ended
        message = f"the link's thread was not ready within {timeout} s"
        raise LinkError("internal", message, fatal=True)

    def wait_attached(self, timeout: Optional[float]) -> Attached:
        """Wait for a connection, up to `timeout` seconds; None: until there is one, or the end."""
        protocol = self._protocol
        with self._changed:
            if self._loop is None and protocol.ended is None:
                raise _not_started()
            self._changed.wait_for(lambda: protocol.attached or protocol.ended, timeout)
            if protocol.attached is not None:
                return protocol.attached
            if protocol.ended is not None:
                raise protocol.ended
            message = f"not attached within {timeout} s ({self._trouble or 'no answer yet'})"
            raise LinkError("timeout", message)

    def send(self, stamp: Stamp, body: str, lost: int) -> bool:
        """Queue an event; False where it is lost instead."""
        with self._lock:
            queued = self._protocol.send(_stamp_value(stamp), body, lost)
            self._wake()
            self._tell_soon()
        return queued

    def ask(self, stamp: Stamp, body: str, lost: int, seconds: float, then: Then) -> None:
        """Queue an event that wants an answer; `then` gets it within that time, maybe at once."""
        with self._lock:
            if self._loop is None and self._protocol.ended is None:
                raise _not_started()
            asked = self._protocol.ask(_stamp_value(stamp), body, lost)
            self._tell_soon()
            if self._loop is not None and not isinstance(asked, Answer):
                self._asks[asked.number] = asked, then
                if self._deadlines.add(self._loop.time() + seconds, asked.number):
                    self._loop.call_soon_threadsafe(self._set_timer, self._loop)
                if self._at_once is None:
                    self._wake()
        if isinstance(asked, Answer):
            _call(then, asked)
        elif self._at_once is not None:
            self._at_once()

    def miss(self, count: int) -> bool:
        """Have the next event tell that so many were lost before it; True where it has to."""
        with self._lock:
            return self._protocol.miss(count)

    def handled(self, answer: Answer, passed: bool, why: Why) -> None:
        """Queue what was done with an ask, to be sent with others of the next moments."""
        with self._lock:
            self._handlings.append((answer, passed, why))
            if len(self._handlings) == 1:
                self._soon(self._gather_handlings)

    def clock(
        self, stamps: Union[Iterable[ClockStamp], Callable[[], Iterable[ClockStamp]]]
    ) -> None:
        """Queue clocks after every event queued so far."""
        with self._lock:
            self._protocol.clock(stamps() if callable(stamps) else stamps)
            if self._at_once is None:
                self._wake()
        if self._at_once is not None:
            self._at_once()

    def renew(self, stamps: Callable[[], Iterable[ClockStamp]]) -> None:
        """End the session by clocks that go back."""
        with self._lock:
            self._protocol.renew(stamps())
            notices = self._protocol.take_notices()
            self._wake()
        self._deliver(notices)

    def describe(self, stream: str, kind: str, facts: Mapping[str, Any]) -> None:
        """Queue a report about a stream."""
        with self._lock:
            if self._protocol.report(stream, kind, **facts):
                self._wake()

    def stats(self) -> Stats:
        """The counters, as they are now."""
        with self._lock:
            return self._protocol.stats()

    def detach(self) -> None:
        """Take nothing more, answer what was asked, and detach when all is written."""
        with self._lock:
            self._protocol.close()
            notices = self._protocol.take_notices()
        self._deliver(notices)
        with self._lock:
            self._put_handlings()
            self._protocol.detach()
            self._awake = False  # there may be no event to write, yet something to do
            self._wake()

    def call_soon(self, callback: Callable[[], Any]) -> None:
        """Call something in the link's thread, as long as it runs."""
        with self._lock:
            if self._loop is not None:
                self._loop.call_soon_threadsafe(callback)

    # From the link's thread

    def open(self, loop: asyncio.AbstractEventLoop, pump: Callable[[], None]) -> None:
        """Call `pump`, on its loop, whenever there is something to write."""
        with self._changed:
            self._loop, self._pump, self._thread = loop, pump, threading.get_ident()
            self._opened = True
            self._changed.notify_all()

    def hello(self) -> str:
        """The first frame of a connection."""
        with self._lock:
            return self._protocol.hello()

    def next_frame(self) -> Optional[str]:
        """The next frame to write, or None until `pump` is called."""
        with self._lock:
            frame = self._protocol.next_frame()
            self._awake = frame is not None
            return frame

    def receive(self, frame: bytes) -> bool:
        """Take in one frame; True where it was the last. Raises what ends the connection."""
        try:
            with self._lock:
                self._protocol.receive(frame)
        finally:  # what a bad frame changed before it failed is delivered at once
            with self._lock:
                notices = self._protocol.take_notices()
            self._deliver(notices)
        for notice in notices:
            if isinstance(notice, LinkError) and notice.fatal:
                raise notice
        return self._protocol.detached

    def disconnected(self, error: LinkError) -> None:
        """Note that there is no connection, and report it."""
        with self._lock:
            was_attached = self._protocol.attached is not None
            self._protocol.disconnected()
            news = str(error) != str(self._trouble)
            self._trouble = error
        if was_attached:
            _call(self._on_state, "disconnected", str(error))
        elif news and not error.fatal:  # attempts that fail alike are reported once
            self.report(error)

    @property
    def attached(self) -> Optional[Attached]:
        """What the server answered on this connection; None without one."""
        return self._protocol.attached

    @property
    def done(self) -> bool:
        """Whether there is nothing left to connect for."""
        with self._lock:
            return self._protocol.done

    @property
    def detached(self) -> bool:
        """Whether the server has confirmed that all was judged."""
        return self._protocol.detached

    def end(self, error: LinkError) -> None:
        """No connection will come any more; nothing where that is known."""
        with self._changed:
            self._loop = None
            if self._protocol.ended is not None:
                return
            self._protocol.end(error)
            notices = self._protocol.take_notices()
            self._changed.notify_all()
        self._deliver(notices)
        _call(self._on_state, "ended", str(error))

    def report(self, error: LinkError) -> None:
        """Pass an error to `on_error`, else log it."""
        if self._on_error is None:
            logs.warn("%s", error)
        _call(self._on_error, error)

    def _set_timer(self, loop: asyncio.AbstractEventLoop) -> None:
        if self._timer is not None:
            self._timer.cancel()
        due = self._deadlines.timer
        self._timer = None if due is None else loop.call_at(due, self._expire, loop)

    def _expire(self, loop: asyncio.AbstractEventLoop) -> None:
        with self._lock:
            for number in self._deadlines.take_due(loop.time(), self._asks):
                self._protocol.expire(self._asks[number][0])
            self._set_timer(loop)
            notices = self._protocol.take_notices()
        self._deliver(notices)

    def _send_handlings(self) -> None:
        with self._lock:
            self._put_handlings()
            self._wake()

    def _put_handlings(self) -> None:
        for answer, passed, why in self._handlings:
            self._protocol.handled(answer, passed, why)
        self._handlings.clear()

    def _wake(self) -> None:
        if self._loop is not None and not self._awake:
            self._awake = True
            if self._later is not None:
                self._later()
            else:
                self._soon(self._pump)

    def _soon(self, call: Callable[[], None]) -> None:
        """Call something in the link's thread."""
        if self._loop is None:
            return
        if threading.get_ident() == self._thread:
            self._loop.call_soon(call)
        else:
            self._loop.call_soon_threadsafe(call)

    def _tell_soon(self) -> None:
        """Deliver what a loss has to tell: a server to which nothing goes may answer nothing."""
        if self._protocol.has_notices:
            self._soon(self._tell)

    def _tell(self) -> None:
        with self._lock:
            notices = self._protocol.take_notices()
        self._deliver(notices)

    def _gather_handlings(self) -> None:
        asyncio.get_running_loop().call_later(HANDLINGS_AFTER, self._send_handlings)

    def _deliver(self, notices: List[Notice]) -> None:
        for notice in notices:
            if isinstance(notice, Answered):
                with self._lock:
                    _, then = self._asks.pop(notice.event.number)
                _call(then, notice.answer)
            elif isinstance(notice, Attached):
                with self._changed:
                    self._trouble, self._refusal = None, ""
                    self._awake = False  # what was queued meanwhile waits for a writer
                    self._wake()
                    self._changed.notify_all()
                _call(self._on_state, "attached", notice.session)
            elif isinstance(notice, Room):
                with self._lock:
                    self._wake()
            elif isinstance(notice, Violation):
                _call(self._on_violation, notice.record)
            elif isinstance(notice, Revision):
                _call(self._on_revision, notice.record)
            elif isinstance(notice, Episode):
                _call(self._on_episode, notice.frame)
            elif isinstance(notice, Verdicts):
                _call(self._on_verdicts, notice.frame)
            elif not notice.fatal and self._is_news(notice):  # a fatal one is reported at the end
                self.report(notice)

    def _is_news(self, error: LinkError) -> bool:
        """False where the server refuses to attach as it did at the last attempt."""
        if self.attached is not None:
            return True
        before, self._refusal = self._refusal, str(error)
        return before != self._refusal


def _not_started() -> LinkError:
    return LinkError("closed", "the link was not started")


def _nothing() -> None:
    pass


def _stamp_value(stamp: Stamp) -> Optional[int]:
    value = stamp() if callable(stamp) else stamp
    return None if value is None else index(value)


def _call(callback: Optional[Callable[..., None]], *arguments: Any) -> None:
    """Call what the adapter gave; its exceptions are logged and don't disturb the link."""
    if callback is None:
        return
    try:
        callback(*arguments)
    except Exception:  # noqa: BLE001 - whatever it is
        logs.failure("a callback of the link failed")
