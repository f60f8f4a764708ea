"""The address of the master, and the name of the adapter's node: ROS ends another one that had it before."""

from __future__ import annotations

import time
from typing import Any, Callable, Optional, Sequence
from urllib.parse import urlsplit
from xmlrpc.client import Fault, ServerProxy

import rosgraph
import rospy
from rosgraph.names import load_mappings, resolve_name

from oracle_ros1.graph import master_proxy
from oracle_ros1.timed import TimedTransport

FREE_WITHIN = 10.0
"""Seconds for which an adapter that is ending keeps its name, at the most."""
ASK_WITHIN = 3.0
"""Seconds that a node may take to answer."""


def no_master() -> str:
    """Why the master's address is none, which rospy would try for ever; empty where it is one."""
    address = rosgraph.get_master_uri()
    try:
        parts = urlsplit(address)
        is_one = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:
        is_one = False
    if is_one or not address:  # without one rospy has its own
        return ""
    return f"ROS_MASTER_URI: '{address}' is no address like http://localhost:11311"


def taken(own: str, arguments: Sequence[str], warn: Callable[[str], None]) -> str:
    """Why this process can't have a node of its `own` name, or that of `arguments`; empty where it can.

    To be called before there is a node. Another one that is ending is waited for, and `warn` called then.
    """
    name = resolve_name(load_mappings(arguments).get("__name", own), rospy.get_caller_id())
    end, warned = time.monotonic() + FREE_WITHIN, False
    while True:
        address = _other(name)
        if address is None:
            return ""
        found = f"another node named {name} runs at {address}"
        if time.monotonic() > end:
            return f"{found}, and would be ended by this one: give this one another name by --monitor, or end that one"
        if not warned:
            warn(f"{found}: waiting for its end, for {FREE_WITHIN:.0f} s at most")
            warned = True
        time.sleep(0.2)


def _other(name: str) -> Optional[str]:
    """Where a node of this name is; None where there is none, or the master is not there to say so."""
    caller = rospy.get_caller_id()
    try:
        master = master_proxy(ASK_WITHIN)
        code, _, address = master.lookupNode(name)
        if code != 1:
            return None
        node: Any = ServerProxy(address, transport=TimedTransport(ASK_WITHIN))
        try:
            code, _, found = node.getName(caller)
        except Fault:  # as those in C++ have no such method
            return None if _is_known_otherwise(master, name, address) else str(address)
    except Exception:  # noqa: BLE001 - nobody answers, or what is no node
        return None
    return str(address) if code != 1 or found == name else None


def _is_known_otherwise(master: Any, name: str, address: str) -> bool:
    """Whether the master has a node of another name at an address: it got the port of one that was killed."""
    _, _, state = master.getSystemState()
    nodes = {node for entries in state for _, users in entries for node in users} - {name}
    return any(master.lookupNode(node)[2] == address for node in nodes)
