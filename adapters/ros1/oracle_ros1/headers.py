"""Connection headers: what nodes say of themselves, and of their messages, as they connect."""

from __future__ import annotations

from typing import List, Mapping

import rospy

Header = Mapping[str, str]


def header_of(message: rospy.AnyMsg) -> Header:
    """The connection header of a message's publisher."""
    header: Header = message._connection_header  # noqa: SLF001 - rospy's own interface
    return header


def headers(subscriber: rospy.Subscriber) -> List[Header]:
    """The connection headers of the publishers that are connected."""
    connections = subscriber.impl.connections if subscriber.impl else []
    return [header for header in (c.header for c in connections or []) if header and "error" not in header]


def node_of(header: Header) -> str:
    """Whose a connection is: a client need not say it."""
    return header.get("callerid") or "an unknown node"
