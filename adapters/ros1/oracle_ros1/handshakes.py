"""Who connects to this node: by an address that must be known, and each heard by itself."""

from __future__ import annotations

import socket
import threading
from collections import defaultdict
from contextlib import suppress
from typing import Any, Callable, DefaultDict
from urllib.parse import urlsplit

import rospy
from oracle_adapter.unread import Recent
from rospy.impl import tcpros_service
from rospy.impl.tcpros_base import TCPROSServer

from oracle_ros1.headers import Header, node_of

SAID_WITHIN = 10.0
"""Seconds that one may take to say its header."""
REACHED_WITHIN = 5.0
"""Seconds that it may take to connect to this node."""

Answer = Callable[[Any, socket.socket, Any], None]
MISCALLED: DefaultDict[str, Recent] = defaultdict(Recent)
"""Who could not call a service of this node's, by its name: rospy tells it the caller alone."""


def hear_each_by_itself() -> None:
    """Have rospy take the next connection at once; to be called before there is a node.

    By itself it does so once the last one has said its header: one that says nothing, as of a machine that was switched
    off or a program that looks for ports, would keep all callers and subscribers waiting that come after it.
    """
    answer: Answer = TCPROSServer._tcp_server_callback  # noqa: SLF001 - rospy has no other place for it

    def take(server: Any, connection: socket.socket, address: Any) -> None:
        threading.Thread(target=_hear, args=(answer, server, connection, address), daemon=True).start()

    TCPROSServer._tcp_server_callback = take  # noqa: SLF001


def note_refused_callers() -> None:
    """Have it noted in `MISCALLED` who calls by another definition; to be called before there is a node."""
    answer = tcpros_service.service_connection_handler

    def handle(connection: socket.socket, address: Any, header: Header) -> Any:
        why = answer(connection, address, header)
        service = tcpros_service.get_service_manager().get_service(header.get("service"))
        if why and service and header.get("md5sum", "") not in ("", service.service_class._md5sum):  # noqa: SLF001
            caller, kind = node_of(header), service.service_class._type  # noqa: SLF001 - genpy's own interface
            MISCALLED[service.resolved_name].add(
                f"{caller} calls {service.resolved_name} by another type than {kind}, or another definition of it than "
                "is installed here: it gets an error"
            )
        return why

    tcpros_service.service_connection_handler = handle


def tell_wrong_address() -> None:
    """Tell in the log where nobody can connect to this node; in a thread of its own, as that may take long."""
    threading.Thread(target=_connect_to, args=(rospy.get_node_uri(),), daemon=True).start()


def _connect_to(address: str) -> None:
    parts, why = urlsplit(address), ""
    try:
        socket.create_connection((parts.hostname or "", parts.port or 0), REACHED_WITHIN).close()
    except (socket.gaierror, UnicodeError):
        why = "which is not known here"
    except OSError as error:
        why = f"where it does not reach itself ({error})"
    if why:
        rospy.logerr(
            f"other nodes are told to connect to this one at {address}, {why}: unless they can, its services and what "
            "it forwards can't be reached, and who publishes later is not heard; set ROS_HOSTNAME or ROS_IP"
        )


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
