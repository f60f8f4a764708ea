"""The protocol of one monitor's connection as a state machine, without a socket: which frame is allowed when.

It needs no asyncio and no clock. `receive` takes the monitor's frames, and `next_message` returns their messages.
`send`, `greet`, `drop` and `finish` queue frames for the monitor, and `next_frame` returns them; then `end` is how to
close the connection.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from enum import Enum
from typing import Any, Final, NamedTuple, get_args

from msgspec import Raw

from oracle_server.wire.data import Decoders, nothing
from oracle_server.wire.errors import WireError
from oracle_server.wire.frames import AttachedFrame, Outgoing
from oracle_server.wire.incoming import (
    AnyClock,
    AnyEvent,
    Attach,
    Detach,
    HandlingMessage,
    HandlingsMessage,
    Message,
    Quick,
    QuickEvent,
    QuickHandlings,
    RawEvents,
    ReportMessage,
)
from oracle_server.wire.reading import decode, event_in


class State(Enum):
    """The state of a conversation."""

    WAITING = "no frame has been received yet"
    ATTACHING = "the session is being opened or committed"
    ATTACHED = "the monitor is greeted, and its frames are processed"
    DETACHING = "the monitor has detached, and its events are being committed"
    ENDED = "the last frame is queued, or the connection is lost"


class Local(Enum):
    """An event on the server's side."""

    GREETED = "the session is open and committed"
    FINISHED = "a last frame is queued"
    LOST = "the connection is lost"


class Refusal(NamedTuple):
    """A frame is answered by an error; `message` defaults to that of the error that reading the frame raised."""

    code: str
    message: str | None = None
    fatal: bool = False


class Otherwise(Enum):
    """Neither a state nor a refusal."""

    LATER = "the frame must be received again later"
    IGNORED = "it has no effect"


Received = (
    Attach
    | AnyEvent
    | AnyClock
    | HandlingMessage
    | HandlingsMessage
    | QuickHandlings
    | ReportMessage
    | Detach
    | WireError
)
"""A message of a monitor; a `WireError` is an event that can't be read, whose number is used up."""
Step = State | Refusal | Otherwise
"""The effect of a frame or local event: the next state where it is accepted, or why it is not."""

_TAKEN: Final = frozenset({*get_args(Message), *get_args(Quick)} - {Attach, Detach})
FRAMES: Final = frozenset({*_TAKEN, Attach, Detach, WireError, bytes})
"""The types of frames: messages, texts that can't be read, and bytes."""

_BYTES: Final[dict[type | Local, Step]] = {bytes: Refusal("malformed", "frames are text, not bytes", fatal=True)}
_ENDINGS: Final[dict[type | Local, Step]] = {
    Local.GREETED: Otherwise.IGNORED,
    Local.FINISHED: State.ENDED,
    Local.LOST: State.ENDED,
}

TABLE: Final[Mapping[State, Mapping[type | Local, Step]]] = {
    State.WAITING: {
        **dict.fromkeys(FRAMES, Refusal("bad_attach", "the first frame must be `attach`", fatal=True)),
        Attach: State.ATTACHING,
        WireError: Refusal("bad_attach", fatal=True),
        **_BYTES,
        **_ENDINGS,
    },
    State.ATTACHING: {
        **dict.fromkeys(FRAMES, Otherwise.LATER),
        **_ENDINGS,
        Local.GREETED: State.ATTACHED,
    },
    State.ATTACHED: {
        **dict.fromkeys(_TAKEN, State.ATTACHED),
        Attach: Refusal("bad_attach", "attached already"),
        Detach: State.DETACHING,
        WireError: State.ATTACHED,  # returned as a message: an event that can't be read uses up its number
        **_BYTES,
        **_ENDINGS,
    },
    State.DETACHING: {
        **dict.fromkeys(FRAMES, Refusal("detached", "the monitor has detached; what it sends now is not judged")),
        **_BYTES,
        **_ENDINGS,
    },
    State.ENDED: dict.fromkeys((*FRAMES, *Local), Otherwise.IGNORED),
}

MAX_QUEUE: Final = 10_000
"""Frames that may wait for some seconds; a monitor with more is disconnected, and resumes by itself."""
MAX_BURST: Final = 50_000
"""Frames that may wait at any time: all held events may be judged, and their frames sent, at once."""

_AT_ONCE: Final = 64
"""Outcomes that are recorded at once: a frame of a megabyte has 25,000."""
_CLOSE_CODES: Final = {"shutting_down": 1012, "moved": 1012, "history_unavailable": 1013}
"""The close codes after fatal errors; `_REFUSED` after all others."""
_REFUSED: Final = 1008
_UNGREETED: Final = (State.WAITING, State.ATTACHING)


class Conversation:
    """The frames between the server and one monitor on one connection, from the first to the last."""

    def __init__(self) -> None:
        self.state = State.WAITING
        self.ended = False
        """Whether no more frames are received or queued."""
        self.end = 1000, ""
        """The close code and reason of a conversation that has ended; no reason where the monitor left."""
        self.in_batch = False
        """Whether `next_message` may return more of a batch."""
        self.queue: deque[Outgoing] = deque()
        """The frames that wait, in their order; before the greeting they must not be written."""
        self._steps = TABLE[self.state]
        self._messages: Iterator[Any] = iter(())
        self.decoders: Decoders = nothing
        """What is decoded of the events of each stream: until the session is known, nothing."""
        self._throttled = False

    # From the monitor

    def receive(self, data: str | bytes, *, batches: bool = True) -> bool:
        """Receive a frame, once `next_message` has returned all of the last one.

        Returns False where it must be received again later: while the session is being opened, or a batch where
        `batches` is False.
        """
        message = _read(data, self.decoders)
        step = self._steps[type(message)]
        batch = _parts(message)
        if step is Otherwise.LATER or (batch is not None and not batches):
            return False
        if isinstance(step, State):
            self._become(step)
            self.in_batch = batch is not None
            self._messages = iter((message,) if batch is None else batch)
        elif isinstance(step, Refusal):
            self.refuse(WireError(step.code, step.message or str(message), fatal=step.fatal))
        return True

    def next_message(self) -> Received | None:
        """The next message of the received frame, None at its end; parts that can't be read are refused."""
        for value in self._messages:
            message: Received = self._event_in(value) if type(value) is Raw else value
            if isinstance(message, WireError):
                self.refuse(message)
                if message.code != "bad_event":
                    continue
            return message
        self.in_batch = False
        return None

    def lost(self) -> None:
        """End the conversation because the connection is lost; waiting frames are dropped."""
        self.queue.clear()
        self._moves(Local.LOST)

    # To the monitor

    def send(self, frame: Outgoing) -> None:
        """Queue a frame; an ack replaces one that waits at the end of the queue."""
        if self.ended:
            return
        queue = self.queue
        if frame["type"] == "ack" and queue and queue[-1]["type"] == "ack":
            queue.pop()
        queue.append(frame)
        if len(queue) > MAX_BURST:
            self._cut_off()

    def greet(self, attached: AttachedFrame, upto: int) -> None:
        """Queue the answer to `attach` before all other frames, and ack events of earlier connections."""
        if self._moves(Local.GREETED):
            self.queue.appendleft(attached)
            if upto:
                self.send({"type": "ack", "upto": upto})

    def refuse(self, error: WireError) -> None:
        """Queue an error; a fatal one ends the conversation."""
        if error.fatal:
            self.drop(error)
        else:
            self.send(error.frame())

    def throttle(self) -> None:
        """Queue the error `throttled`, once in a conversation."""
        if not self._throttled:
            self._throttled = True
            self.send(WireError("throttled", "too many events a second; the rest is read more slowly").frame())

    def cut_off_crowded(self) -> None:
        """End the conversation if more than `MAX_QUEUE` frames wait."""
        if len(self.queue) > MAX_QUEUE:
            self._cut_off()

    def drop(self, reason: WireError) -> None:
        """Send an error after what is queued, and close."""
        self.finish(reason.frame(), _CLOSE_CODES.get(reason.code, _REFUSED), reason.code)

    def finish(self, frame: Outgoing, code: int = 1000, reason: str = "") -> None:
        """Send a last frame after what is queued, and close."""
        ungreeted = self.state in _UNGREETED
        if self._moves(Local.FINISHED):
            if ungreeted:
                self.queue.clear()  # the monitor has not received `attached`
            self.queue.append(frame)
            self.end = code, reason

    # To the socket

    def next_frame(self) -> Outgoing | None:
        """The next frame to write, None while there is none; before the greeting only an error is written."""
        return self.queue.popleft() if self.queue and self.state not in _UNGREETED else None

    def written(self) -> None:
        """Clear the queue after all of it was written."""
        self.queue.clear()

    # Inside

    def _event_in(self, raw: Raw) -> QuickEvent | WireError:
        """An event of a batch, or the error where it can't be read."""
        try:
            return event_in(raw, self.decoders)
        except WireError as error:
            return error

    def _cut_off(self) -> None:
        self.queue.clear()
        self.drop(WireError("too_slow", f"more than {MAX_QUEUE} frames were not read; attach again", fatal=True))

    def _become(self, state: State) -> None:
        if state is not self.state:
            self.state, self.ended, self._steps = state, state is State.ENDED, TABLE[state]

    def _moves(self, what: Local) -> bool:
        step = self._steps[what]
        if not isinstance(step, State):
            return False
        self._become(step)
        if self.ended:
            self._messages, self.in_batch = iter(()), False
        return True


def _parts(message: Message | Quick | WireError | bytes) -> Sequence[Any] | None:
    """What a frame has that is processed one by one, with other connections between; None where it is one message."""
    if isinstance(message, RawEvents):
        return message.events
    if isinstance(message, QuickHandlings | HandlingsMessage) and len(message.outcomes) > _AT_ONCE:
        outcomes: Any = message.outcomes
        return [QuickHandlings(outcomes[i : i + _AT_ONCE]) for i in range(0, len(outcomes), _AT_ONCE)]
    return None


def _read(data: str | bytes, decoders: Decoders) -> Message | Quick | WireError | bytes:
    """A frame as one of the types in `FRAMES`."""
    if isinstance(data, bytes):
        return data
    try:
        return decode(data, decoders)
    except WireError as error:
        return error
