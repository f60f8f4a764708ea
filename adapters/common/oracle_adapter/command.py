"""What is common to the adapters' command lines."""

from __future__ import annotations

import argparse
import os
from typing import TYPE_CHECKING, Callable, Optional, Union

from oracle_adapter.errors import LinkError

if TYPE_CHECKING:
    import threading

    from oracle_adapter.link import Link
    from oracle_adapter.names import Names
    from oracle_adapter.protocol import Attached

DEFAULT_URL = "http://127.0.0.1:8642"


def parser(program: str, description: Optional[str]) -> argparse.ArgumentParser:
    """The options of every adapter; None where one is not given."""
    options = argparse.ArgumentParser(program, description=description)
    options.add_argument("--oracle", help=f"the server; default ORACLE_URL or {DEFAULT_URL}")
    options.add_argument("--spec", help="the spec to judge by; needed where the session is new")
    options.add_argument(
        "--session", help="the session to join or make; default a new one of its own"
    )
    options.add_argument("--monitor", help="this monitor's name; default monitor")
    options.add_argument(
        "--remap",
        action="append",
        default=[],
        metavar="/NAME:=/ROS_NAME",
        help="the name on this robot of a stream of the spec",
    )
    options.add_argument("--namespace", help="the prefix of all names of the spec, such as /uav1")
    options.add_argument(
        "--log", metavar="FILE", help="write events there, as JSON Lines, and use no oracle"
    )
    options.add_argument(
        "--streams",
        metavar="FILE",
        help="for --log, what to observe: the output of `oracle-server streams SPEC`",
    )
    options.add_argument("--token", help="the server's token; default ORACLE_TOKEN")
    return options


def default(name: str) -> Optional[str]:
    """The default of an option."""
    defaults = {
        "oracle": os.environ.get("ORACLE_URL", DEFAULT_URL),
        "monitor": "monitor",
        "token": os.environ.get("ORACLE_TOKEN"),
    }
    return defaults.get(name)


def wait_attached(
    link: Link, stopping: threading.Event, warn: Callable[[str], None]
) -> Optional[Attached]:
    """Wait for the oracle; None where the link has ended or `stopping` is set.

    `warn` gets a text where that takes long.
    """
    warned = False
    while not stopping.is_set():
        found = _attached(link, 0.5)
        if isinstance(found, LinkError):
            if found.fatal:
                return None
            if not warned:
                warn(f"waiting for the oracle: {found}")
            warned = True
        else:
            return found
    return None


def _attached(link: Link, timeout: float) -> Union[Attached, LinkError]:
    try:
        return link.wait_attached(timeout)
    except LinkError as error:
        return error


def close(link: Link, warn: Callable[[str], None]) -> None:
    """Close a link; `warn` gets a text where the oracle did not confirm all that was queued."""
    if not link.close():
        left = link.stats().queued
        if left:
            warn(f"the oracle has not confirmed the last {left} events: they may be lost")


def unknown_remap(names: Names, attached: Attached) -> Optional[str]:
    """A remapped name that is none of a stream or a proxy of the spec; None where there is none."""
    known = (n for s in attached.streams for n in (s["name"], s.get("proxy") or s["name"]))
    return next(iter(names.unused(known)), None)
