"""Who connects to this node: rospy hears the next one only once the last one has said its header."""

from __future__ import annotations

import socket
import threading
from contextlib import suppress
from typing import Any, Callable

from rospy.impl.tcpros_base import TCPROSServer

SAID_WITHIN = 10.0
"""Seconds that one may take to say its header."""

Answer = Callable[[Any, socket.socket, Any], None]


def hear_each_by_itself() -> None:
    """Have rospy take the next connection at once; to be called before there is a node.

    Else one that says nothing, as of a machine that was switched off or a program that looks for ports, would keep all
    callers and subscribers waiting that come after it.
    """
    answer: Answer = TCPROSServer._tcp_server_callback  # noqa: SLF001 - rospy has no other place for it

    def take(server: Any, connection: socket.socket, address: Any) -> None:
        threading.Thread(target=_hear, args=(answer, server, connection, address), daemon=True).start()

    TCPROSServer._tcp_server_callback = take  # noqa: SLF001


def _hear(answer: Answer, server: Any, connection: socket.socket, address: Any) -> None:
    late = threading.Timer(SAID_WITHIN, _hang_up, (connection,))
    late.daemon = True
    late.start()
    try:
        answer(server, connection, address)  # until it has said what it wants, which goes on in a thread of rospy's
    finally:
        late.cancel()


def _hang_up(connection: socket.socket) -> None:
    with suppress(OSError):  # it has gone
        connection.shutdown(socket.SHUT_RDWR)
