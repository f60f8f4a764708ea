"""The events that a service of ROS 2 tells of its calls by introspection: messages, of no definition of their own."""

from __future__ import annotations

import re

from oracle_server.rostypes.definition import Fields

_NAME = re.compile(r"(?P<service>\w+/srv/\w+)_Event")


def service_of(name: str) -> str:
    """The service of whose events a full name is the type, as `pkg/srv/Name_Event`; empty for any other type."""
    match = _NAME.fullmatch(name)
    return match["service"] if match else ""


def event_fields(service: str) -> Fields:
    """The fields of the events of a service, by its full name."""
    return {
        "info": "service_msgs/msg/ServiceEventInfo",
        "request": f"{service}_Request[]",
        "response": f"{service}_Response[]",
    }
