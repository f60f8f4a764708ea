"""The types of ROS's standard packages, of all distributions: `standard.json`, which scripts/standard-types writes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Any

from oracle_server.core.hazards.ros import Ros
from oracle_server.rostypes.definition import Fields


def variants(name: str, ros: Ros | None = None) -> Sequence[Fields]:
    """What a message has been over the distributions, the newest of ROS 2 first, or ROS 1's where that is asked for.

    With a version of ROS only those of that version, unless it has none; empty for a type that is none of these.
    """
    data = _data()
    one = [data["1"][name]] if name in data["1"] else []
    two = data["2"].get(name, [])
    if ros is None:
        return [*two, *one]
    return (one or two) if ros == 1 else (two or one)


@cache
def names() -> frozenset[str]:
    """The full names of all of them; services by `pkg/srv/Name_Request` and `pkg/srv/Name_Response`."""
    return frozenset(_data()["1"]) | frozenset(_data()["2"])


@cache
def _data() -> Mapping[str, Any]:
    data: Mapping[str, Any] = json.loads(files(__package__).joinpath("standard.json").read_bytes())
    return data
