"""What is common to the adapters' command lines."""

from __future__ import annotations

import argparse
import os
from typing import TYPE_CHECKING, Any, Callable, Dict, Optional, Sequence, Tuple, Union

from oracle_adapter.errors import LinkError
from oracle_adapter.interfaces import interfaces_of
from oracle_adapter.link import Link

if TYPE_CHECKING:
    import threading

    from oracle_adapter.kinds import InterfaceType
    from oracle_adapter.names import Names
    from oracle_adapter.notices import Attached

DEFAULT_URL = "http://127.0.0.1:8642"
FREE_WITHIN = 10.0
"""Seconds for which an adapter that is ending keeps the data directory, at the most."""


def parser(program: str, description: Optional[str]) -> argparse.ArgumentParser:
    """The options of every adapter; None where one is not given."""
    options = argparse.ArgumentParser(program, description=description)
    options.add_argument(
        "--oracle",
        help="the server, or several over one history, with commas between; a UNIX socket as "
        f"unix:///PATH; default ORACLE_URL or {DEFAULT_URL}",
    )
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
    options.add_argument(
        "--embedded",
        metavar="SPEC",
        help="judge in this process, by the spec in that file, without a server; needs Python 3.11",
    )
    options.add_argument(
        "--data",
        metavar="DIR",
        help="for --embedded, the folder of the history; default that of oracle-server",
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


def demand_one_oracle(given: argparse.Namespace) -> None:
    """Raise ValueError where options that were given say two things of where events go."""
    if given.log and not given.embedded:
        names = ("oracle", "spec", "session")
        asked = next((name for name in names if getattr(given, name)), None)
        if asked is not None:
            raise ValueError(f"--log asks no oracle: leave --{asked} out, or leave --log out")
    if given.streams and not given.log:
        raise ValueError("--streams is for --log: name the log's file, or leave --streams out")


def make_link(options: argparse.Namespace, **more: Any) -> Link:
    """The link to the server that the options name, or to an oracle in this process.

    `more` is as for `Link`. Raises `LinkError` and `ValueError`.
    """
    if not options.embedded:
        if options.data:
            raise ValueError("--data is for --embedded; a server has its own data directory")
        return Link(
            options.oracle,
            options.monitor,
            spec=options.spec,
            session=options.session,
            token=options.token,
            **more,
        )
    if options.spec or options.log:
        given = "--spec" if options.spec else "--log"
        raise ValueError(f"--embedded names the spec and uses no server: leave {given} out")
    from oracle_adapter.embedded import EmbeddedLink, log_warnings

    log_warnings()
    return EmbeddedLink(
        options.embedded,
        options.data,
        options.monitor,
        FREE_WITHIN,
        session=options.session,
        **more,
    )


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


def check_names(
    names: Names, attached: Attached, on_graph: Callable[[InterfaceType, str], Sequence[str]]
) -> None:
    """Raise ValueError where the spec has no stream of a remapped name, or two are one here.

    So it is where a stream and its proxy are one: what passes would come again, for ever.
    `on_graph` returns all names that an interface of a name has, as ROS's own remaps make them.
    """
    known = (n for s in attached.streams for n in (s["name"], s.get("proxy") or s["name"]))
    for unknown in names.unused(known):
        raise ValueError(f"--remap {unknown}: {attached.spec} has no such stream")
    taken: Dict[Tuple[str, str], str] = {}
    for interface in interfaces_of(attached.streams):
        own = on_graph(interface.type, names[interface.name])
        for here in own:
            other = taken.setdefault((interface.type, here), interface.name)
            if other != interface.name:
                raise ValueError(
                    f"--remap: {other} and {interface.name} would both be {here} here; "
                    "give one of them another name"
                )
        proxy = interface.proxy and on_graph(interface.type, names[interface.proxy])
        for here in set(own).intersection(proxy):
            raise ValueError(
                f"{interface.name} and its proxy {interface.proxy} would both be {here} here, so "
                "that what passes comes again: take the remap away that makes them one, as by a "
                "<remap> that is meant for other nodes"
            )
