"""The classes of messages and services: those that are installed, and those that publishers define as they connect."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any, Optional

import genpy.dynamic
import roslib.message

from oracle_ros1.codec import CodecError, Lookup
from oracle_ros1.headers import Header, node_of

_generating = threading.Lock()  # genpy writes modules and changes the path where they are looked for


@dataclass(frozen=True)
class Definition:
    """A message's class, and where the classes of its fields are found."""

    type: Any
    lookup: Lookup


def ros1_name(name: str) -> str:
    """`pkg/msg/Type` or `pkg/srv/Type` as ROS 1 has it: `pkg/Type`."""
    package, _, rest = name.partition("/")
    return f"{package}/{rest.rpartition('/')[2]}"


def installed_message(name: str) -> Optional[Definition]:
    """The installed class of `pkg/Type`, None where its package is not there."""
    try:
        found = roslib.message.get_message_class(name)
    except ValueError:
        found = None
    return None if found is None else Definition(found, lookup_installed)


def installed_service(name: str) -> Any:
    """The class of the service `pkg/Type`. Raises `CodecError`: who serves or calls it sends no definition along."""
    try:
        found = roslib.message.get_service_class(name)
    except (ValueError, ImportError):
        found = None
    if found is None:
        raise CodecError(f"the service type {name} can't be loaded; is its package built and sourced?")
    return found


def lookup_installed(name: str) -> Any:
    """The installed class of `pkg/Type`. Raises `CodecError`."""
    found = installed_message(name)
    if found is None:
        raise CodecError(f"the type {name} can't be loaded; is its package built and sourced?")
    return found.type


def sent_definition(header: Header) -> Definition:
    """The class that a publisher's connection header defines. Raises `CodecError`."""
    name, text = header.get("type", ""), header.get("message_definition", "")
    try:
        with _generating:
            classes = genpy.dynamic.generate_dynamic(name, text)
    except Exception as error:  # genpy imports what it makes of a text that another node sends
        raise CodecError(f"{name} as {node_of(header)} defines it can't be read: {error}") from error
    made = classes[name]
    if made._md5sum != header.get("md5sum"):  # noqa: SLF001 - genpy's own interface
        raise CodecError(f"the definition of {name} that {node_of(header)} sends is not that of its messages")
    return Definition(made, classes.__getitem__)
