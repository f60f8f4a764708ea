"""A WebSocket with no queue between the transport and its user."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Callable, Iterable, List, Optional

from websockets.asyncio.client import ClientConnection
from websockets.exceptions import InvalidState
from websockets.frames import Frame, Opcode

if TYPE_CHECKING:
    from websockets.protocol import Event

_DATA = frozenset({Opcode.TEXT, Opcode.BINARY, Opcode.CONT})


class WebSocket(ClientConnection):
    """Hands over messages as they come, and writes many at a time.

    `recv` and `send` take a turn of the event loop, and a system call, for each.
    """

    on_message: Optional[Callable[[bytes], None]] = None
    """Gets each message, and must not raise; until it is set they are left to `recv`."""
    on_room: Optional[Callable[[], None]] = None
    """Called once `full` is over."""
    full = False
    """Whether so much waits to be taken by the other side that nothing more should be written."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._parts: List[bytes] = []

    def write(self, texts: Iterable[str]) -> None:
        """Write messages without waiting; nothing once the connection is about to end."""
        try:
            for text in texts:
                self.protocol.send_text(text.encode())
        except InvalidState:
            return
        self.transport.write(b"".join(self.protocol.data_to_send()))

    # What the library calls

    def process_event(self, event: Event) -> None:
        """Take in a frame, or what else has come."""
        if self.on_message is None or not isinstance(event, Frame) or event.opcode not in _DATA:
            super().process_event(event)
            return
        self._parts.append(bytes(event.data))
        if event.fin:
            message, self._parts = b"".join(self._parts), []
            self.on_message(message)

    def pause_writing(self) -> None:
        """Note that the other side is slow."""
        super().pause_writing()
        self.full = True

    def resume_writing(self) -> None:
        """Go on."""
        super().resume_writing()
        self.full = False
        if self.on_room is not None:
            self.on_room()
