"""The state of one link: what to write next, what a frame means, which asks are open.

No socket, no clock, no threads: calls change the state, `next_frame` and `take_notices` drain what
came of them.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import (
    TYPE_CHECKING,
    Any,
    Callable,
    Dict,
    List,
    Literal,
    Mapping,
    Optional,
    Set,
    Tuple,
    Union,
)

from oracle_adapter.decision import Answer, denied
from oracle_adapter.errors import ENDING, LinkError
from oracle_adapter.jsonvalues import dumps
from oracle_adapter.losses import Losses, place_of, too_large
from oracle_adapter.notices import (
    Answered,
    Attached,
    Episode,
    Notice,
    Revision,
    Room,
    Verdicts,
    Violation,
)
from oracle_adapter.outbox import MAX_FRAME, Outbox
from oracle_adapter.queued import Queued
from oracle_adapter.stats import Stats

if TYPE_CHECKING:
    from oracle_adapter.decision import Why

TimeSource = Literal["field", "middleware", "arrival"]
"""Where a stream's publication time comes from."""


@dataclass(frozen=True)
class Hello:
    """What a monitor sends to attach; `streams` are those it will observe, None for all.

    `verdicts`: whether the state of the properties is wanted; `features`: what else, by the
    server's words for it, which older servers ignore.
    """

    monitor: str
    instance: str
    session: Optional[str] = None
    spec: Optional[str] = None
    streams: Optional[Tuple[str, ...]] = None
    clock: Literal["wall", "sim"] = "wall"
    verdicts: Optional[bool] = None
    features: Optional[Tuple[str, ...]] = None


class Protocol:
    """One monitor's side of the wire, over any number of connections."""

    def __init__(self, hello: Hello, capacity: int) -> None:
        self.attached: Optional[Attached] = None
        """What the server answered on this connection; None without one."""
        self.detached = False
        self.ended: Optional[LinkError] = None
        self._hello, self._private = hello, hello.session is None
        self._stats = Stats()
        self._outbox = Outbox(capacity, self._stats)
        self._open: Set[Queued] = set()  # asks without an answer
        self._notices: List[Notice] = []
        self._reports: Dict[Tuple[str, str], Dict[str, Any]] = {}
        self._unreported: Set[Tuple[str, str]] = set()
        self._handlers: Mapping[str, Callable[[Mapping[str, Any]], None]] = {
            "attached": self._on_attached,
            "ack": self._on_ack,
            "decision": self._on_decision,
            "violation": self._on_violation,
            "revision": self._on_revision,
            "episode": self._on_episode,
            "verdicts": self._on_verdicts,
            "credit": self._on_credit,
            "error": self._on_error,
            "detached": self._on_detached,
        }
        self._losses = Losses()
        self._met = self._closing = self._detaching = self._detach_sent = self._over = False

    # From the adapter

    def send(self, stamp: Optional[int], body: str, lost: int = 0) -> bool:
        """Queue an event; False where it is lost instead."""
        return self._put(stamp, body, lost, ask=False) is not None

    def ask(self, stamp: Optional[int], body: str, lost: int = 0) -> Union[Queued, Answer]:
        """Queue an event that wants an answer; where it is lost instead, that is the answer."""
        event = self._put(stamp, body, lost, ask=True)
        if event is not None:
            self._open.add(event)
            return event
        self._stats.unavailable += 1
        if not self._closed_reason and self._outbox.is_too_large(body):
            return denied(too_large(body))
        return Answer("unavailable", reason=self._closed_reason or "the queue is full")

    def expire(self, event: Queued) -> None:
        """The time to answer an ask is over; what comes for it later is ignored."""
        if not event.waiting:
            return
        if self.attached is not None:
            self._stats.timeouts += 1
            self._answer(event, Answer("timeout", reason="no decision in time", event=event))
        else:
            self._unavailable(event, "no connection to the oracle")

    def handled(self, answer: Answer, passed: bool, why: Why) -> None:
        """Report what was done with an ask, where there is an event to report on."""
        if answer.event is not None and self.ended is None:
            self._outbox.marks.handled(answer.event, passed, why)

    def miss(self, count: int) -> bool:
        """Have the next event tell that so many were lost before it; True where it has to."""
        return self._outbox.miss(count)

    def clock(self, stamps: Any) -> None:
        """Queue the latest clocks."""
        if not self._closed_reason:
            self._outbox.clock(stamps)

    def renew(self, stamps: Any) -> None:
        """End the session by clocks that go back, and continue in the next one."""
        if self._closed_reason:
            return
        self._leave(lambda: self._outbox.renew(stamps), "simulated time went back")

    def report(self, stream: str, kind: str, **facts: Any) -> bool:
        """Report facts of a stream, on all connections; False where they were reported already.

        So it is where the session has no such stream any more.
        """
        if self.attached is not None and not self.attached.has(stream, kind):
            return False
        key = stream, kind
        report = {**self._reports.get(key, {}), **facts}
        loss = self._losses.of(stream, kind)
        if loss and loss not in report.get("trouble", ""):
            report["trouble"] = "; ".join(filter(None, (report.get("trouble"), loss)))
        if self._reports.get(key) == report:
            return False
        self._reports[key] = report
        self._unreported.add(key)
        return True

    def close(self) -> None:
        """Take nothing more, and answer the asks: their handlings must be sent before the end."""
        self._closing = True
        for event in sorted(self._open, key=lambda event: event.number):
            self._unavailable(event, self._closed_reason)

    def detach(self) -> None:
        """Take nothing more, and detach when all is written, with credit for it or without."""
        self._detaching = True
        self._outbox.credit = None

    # From the connection

    def hello(self) -> str:
        """The first frame of a connection; after the first it names the session to resume."""
        frame: Dict[str, Any] = {"type": "attach", **vars(self._hello)}
        return dumps({key: value for key, value in frame.items() if value is not None})

    def receive(self, text: Union[str, bytes]) -> None:
        """Take in one frame; raises `LinkError` for one that can't be understood."""
        try:
            frame = json.loads(text)
            handler = self._handlers.get(frame["type"])
            if handler is not None:  # later servers may send more
                handler(frame)
        except LinkError:
            raise
        except Exception as error:
            message = f"the server sent what is no frame: {text[:200]!r} ({error!r})"
            raise LinkError("bad_frame", message) from error

    def disconnected(self) -> None:
        """The connection is lost."""
        self.attached = None
        self._detach_sent = self._over = False

    def end(self, error: LinkError) -> None:
        """No connection will come any more: answer the asks and count what stays unsent."""
        if self.ended is None:
            self.ended = error
            self.disconnected()
            self._stats.lost += self._outbox.unsent
            for event in sorted(self._open, key=lambda event: event.number):
                self._unavailable(event, str(error))

    # To the connection and the adapter

    def next_frame(self) -> Optional[str]:
        """The next frame to write, or None for now."""
        if self.attached is None or self._detach_sent or self._over:
            return None
        if self._unreported:
            return self._report_frame()
        frame = self._outbox.next_frame()
        if frame is None and self._detaching:
            self._detach_sent = True
            return dumps({"type": "detach"})
        return frame

    @property
    def has_notices(self) -> bool:
        """Whether something has happened since."""
        return bool(self._notices)

    def take_notices(self) -> List[Notice]:
        """What has happened since the last call, in order."""
        taken, self._notices = self._notices, []
        return taken

    @property
    def done(self) -> bool:
        """Whether there is nothing left to connect for."""
        if self.detached or self.ended is not None:
            return True
        empty = not len(self._outbox) and not len(self._outbox.marks)
        return self._detaching and self.attached is None and empty

    def stats(self) -> Stats:
        """A copy of the counters."""
        return replace(self._stats, queued=len(self._outbox))

    # Inside

    @property
    def _closed_reason(self) -> str:
        if self.ended is not None:
            return str(self.ended)
        return "the link is closing" if self._closing or self._detaching else ""

    @property
    def _may_move(self) -> bool:
        """Whether a session of our own was closed while we were away, so that a new one can do."""
        return self._private and self._met and self.attached is None

    def _report_frame(self) -> str:
        streams = [
            {"stream": stream, "kind": kind, **self._reports[stream, kind]}
            for stream, kind in sorted(self._unreported)
        ]
        self._unreported.clear()
        return dumps({"type": "report", "streams": streams})

    def _put(self, stamp: Optional[int], body: str, lost: int, *, ask: bool) -> Optional[Queued]:
        if self._closed_reason:
            self._stats.lost += 1
            return None
        event = self._outbox.put(stamp, body, lost=lost, ask=ask)
        if event is None:
            large = self._outbox.is_too_large(body)
            loss = self._losses.large(body) if large else self._losses.full(len(self._outbox))
            self._notices += [] if loss is None else [loss]
            if large:
                self.report(*place_of(body))
        elif self._losses.is_full and not self._outbox.crowded:
            self._losses.is_full = False
        return event

    def _on_attached(self, frame: Mapping[str, Any]) -> None:
        limits = frame.get("limits") or {}
        attached = Attached(
            monitor=str(frame["monitor"]),
            session=str(frame["session"]),
            spec=frame.get("spec"),
            spec_digest=frame.get("spec_digest"),
            streams=tuple(frame["streams"]),
            limits=limits,
        )
        lost_before = self._stats.lost
        max_frame = int(limits.get("max_frame") or MAX_FRAME)
        upcoming, first = int(frame["next"]), int(frame.get("first") or 0)
        for event in self._outbox.resume(upcoming, max_frame, limits.get("max_batch"), first):
            if event.waiting:
                self._unavailable(event, "the event was lost in a reconnect")
        self._outbox.credit = None if self._detaching else limits.get("credit")
        self._outbox.marks.max_handlings = int(limits.get("max_outcomes") or 1)
        self.attached = attached
        self._reports = {key: facts for key, facts in self._reports.items() if attached.has(*key)}
        self._unreported = set(self._reports)
        # To resume this session, or have it made again from its spec where the server has lost it.
        spec = self._hello.spec or attached.spec
        self._hello = replace(self._hello, session=attached.session, spec=spec)
        self._stats.reconnects += self._met
        self._met = True
        self._notices.append(attached)
        if self._stats.lost > lost_before:
            count = self._stats.lost - lost_before
            self._notices.append(LinkError("lost", f"{count} events were lost in a reconnect"))

    def _on_ack(self, frame: Mapping[str, Any]) -> None:
        self._outbox.ack(int(frame["upto"]))

    def _on_decision(self, frame: Mapping[str, Any]) -> None:
        event = self._outbox.asked.get(int(frame["seq"]))
        if event is None:  # answered before, or given up
            return
        decision = frame["decision"]
        if decision not in ("allow", "deny"):
            self._unavailable(event, f"the server decided {decision!r}")
            return
        denied_by = tuple(frame.get("denied_by") or ())
        verdicts = dict(frame.get("verdicts") or {})
        self._answer(event, Answer("decision", decision, denied_by, verdicts, event=event))

    def _on_violation(self, frame: Mapping[str, Any]) -> None:
        self._notices.append(Violation(_without_type(frame)))

    def _on_revision(self, frame: Mapping[str, Any]) -> None:
        self._notices.append(Revision(_without_type(frame)))

    def _on_episode(self, frame: Mapping[str, Any]) -> None:
        self._notices.append(Episode(_without_type(frame)))

    def _on_verdicts(self, frame: Mapping[str, Any]) -> None:
        self._notices.append(Verdicts(_without_type(frame)))

    def _on_credit(self, frame: Mapping[str, Any]) -> None:
        if self._outbox.credit is not None:
            self._outbox.credit += int(frame["events"])
        self._notices.append(Room())

    def _on_error(self, frame: Mapping[str, Any]) -> None:
        code, seq = str(frame["code"]), frame.get("seq")
        moving = code == "session_closed" and self._may_move
        fatal = code in ENDING and bool(frame.get("fatal", True)) and not moving
        error = LinkError(code, str(frame.get("message", "")), seq=seq, fatal=fatal)
        if code == "moved":
            error.url = frame.get("url")
            raise error  # which ends the connection, not the link
        self._notices.append(error)
        if moving:
            self._hello = replace(self._hello, session=None)
            self._outbox.move()
        if code == "session_ended":
            self._start_over(frame.get("session"), str(error))
        if seq is not None:
            self._stats.refused += 1
            event = self._outbox.asked.get(seq)
            if event is not None:
                self._stats.unavailable += 1
                self._answer(event, denied(str(error), event))

    def _start_over(self, session: Optional[str], reason: str) -> None:
        """Attach to another session next, one without a name where none is given."""
        self._hello = replace(self._hello, session=session)
        self._over = True
        if self._hello.clock == "wall" and self.attached is None:
            # No time went back: the session was closed before, and the next one takes what waits.
            self._outbox.move()
            return
        self._leave(self._outbox.start_over, reason)

    def _leave(self, begin_anew: Callable[[], List[Queued]], why: str) -> None:
        """Go on in the next session, and tell how many events the last one may lack."""
        lost_before = self._stats.lost
        for event in begin_anew():
            if event.waiting:
                self._unavailable(event, why)
        count = self._stats.lost - lost_before
        if count:
            message = f"{count} events may not be in the session that has ended"
            self._notices.append(LinkError("lost", message))

    def _on_detached(self, frame: Mapping[str, Any]) -> None:  # noqa: ARG002 - as all of them
        self.detached = True

    def _unavailable(self, event: Queued, reason: str) -> None:
        self._stats.unavailable += 1
        self._answer(event, Answer("unavailable", reason=reason, event=event))

    def _answer(self, event: Queued, answer: Answer) -> None:
        self._outbox.answered(event)
        self._open.discard(event)
        self._notices.append(Answered(event, answer))


def _without_type(frame: Mapping[str, Any]) -> Mapping[str, Any]:
    return {key: value for key, value in frame.items() if key != "type"}
