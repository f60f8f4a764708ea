"""What in a spec would not work as intended on one version of ROS."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Literal

from oracle_server.core.errors import SpecProblem
from oracle_server.core.hazards.actions import reply_hazards
from oracle_server.core.spec import Spec

Ros = Literal[1, 2]

_WITHOUT_STAMP = {
    "diagnostic_msgs": ("DiagnosticStatus", "KeyValue"),
    "nav_msgs": ("GetMapAction", "GetMapFeedback", "GetMapGoal", "GetMapResult", "MapMetaData"),
    "rosgraph_msgs": ("Clock", "TopicStatistics"),
    "sensor_msgs": ("ChannelFloat32", "JoyFeedback", "JoyFeedbackArray", "LaserEcho", "NavSatStatus", "PointField",
        "RegionOfInterest"),
    "tf2_msgs": ("TFMessage",),
    "visualization_msgs": ("MarkerArray",),
}  # fmt: skip

_TYPES = {"set_parameters": "SetParameters", "set_parameters_atomically": "SetParametersAtomically"}
_SETTERS = dict(zip(_TYPES, reversed(_TYPES), strict=True))
"""What ROS 2's nodes set parameters by, and what else sets the same."""


def ros_hazards(spec: Spec, ros: Ros) -> Iterator[SpecProblem]:
    """What `check --ros` warns of."""
    if ros == 1:
        yield from _arrival_times(spec)
        yield from reply_hazards(spec)
    else:
        yield from _refused_names(spec)
        yield from _denied_responses(spec)


def odd_names(spec: Spec) -> Iterator[SpecProblem]:
    """Names that are none on a robot's graph, or another one there: warnings, whatever the version of ROS."""
    for i, stream in enumerate(spec.streams):
        told = _oddity(stream.name) if stream.leads else ""
        if told:
            path = ("streams", i, stream.traits.group)
            yield SpecProblem(path, f"stream '{stream.name}': {told}", severity="warning")


def _oddity(name: str) -> str:
    """What is odd about a name, and what to write; empty for nothing."""
    if set("~{}") & set(name):
        return "no name on a robot's graph has `~`, `{` or `}`; write the whole name, as in `/base/cmd_vel`"
    plain = re.sub("/+", "/", name.rstrip("/"))
    if plain == name:
        return ""
    odd = "with `//`" if "//" in name else "that ends with `/`"
    mend = f"; write `{plain}`" if plain else ""
    return f"ROS 2 has no name {odd}, and ROS 1 reads `{plain or '/'}` for it{mend}"


def _refused_names(spec: Spec) -> Iterator[SpecProblem]:
    """Names that ROS 1 has, and ROS 2 refuses."""
    for i, stream in enumerate(spec.streams):
        odd = "in which a part begins with a digit" if re.search("(^|/)[0-9]", stream.name) else ""
        odd = "with `__`" if "__" in stream.name else odd
        if stream.leads and odd:
            path = ("streams", i, stream.traits.group)
            yield SpecProblem(path, f"stream '{stream.name}': ROS 2 has no name {odd}", severity="warning")


def twins_left_open(spec: Spec) -> Iterator[SpecProblem]:
    """Services that set a node's parameters and are filtered, beside the other one that does and is not: warnings."""
    filtered = {stream.name for stream in spec.streams if stream.kind == "request" and stream.action == "filter"}
    for i, stream in enumerate(spec.streams):
        node, _, name = stream.name.rpartition("/")
        twin = _SETTERS.get(name)
        if twin is None or stream.kind != "request" or stream.name not in filtered:
            continue
        package, _, kind = stream.type.partition("/")
        is_setter = package == "rcl_interfaces" and kind.removeprefix("srv/") == _TYPES[name]
        if is_setter and f"{node}/{twin}" not in filtered:
            yield SpecProblem(
                ("streams", i, stream.traits.group),
                f"{stream.name} is filtered, and `{node}/{twin}`, which sets the same parameters, is not: "
                f"filter it too, with `type: rcl_interfaces/srv/{_TYPES[twin]}`",
                severity="warning",
            )


def _denied_responses(spec: Spec) -> Iterator[SpecProblem]:
    """ROS 2 has no service errors: without `denied_response` a denied call is answered by the type's defaults."""
    for i, stream in enumerate(spec.streams):
        if stream.kind == "request" and stream.action == "filter" and stream.denied_response is None:
            yield SpecProblem(
                ("streams", i, "action"),
                f"{stream.name} is filtered without a `denied_response`: on ROS 2 a denied call is answered by the "
                "defaults of the response's type, which a client may take for a success",
                severity="warning",
            )


def _arrival_times(spec: Spec) -> Iterator[SpecProblem]:
    """ROS 1 carries no publication time: a topic whose messages hold none is ordered by its arrival.

    What it carries of services and actions has a time: their own, or that at which the adapter forwards it.
    """
    if spec.ordering.by == "arrival":
        return
    for i, stream in enumerate(spec.streams):
        if stream.kind == "topic" and stream.ordered and stream.stamp is None and _has_no_stamp(stream.type):
            yield SpecProblem(
                ("streams", i, stream.traits.group),
                f"{stream.name} is ordered by its arrival on ROS 1, which carries no publication time: {stream.type} "
                "has neither `header.stamp` nor `stamp`; name the field under `stamp`, or say `ordered: false`",
                severity="warning",
            )


def _has_no_stamp(name: str) -> bool:
    """Whether a type is one of ROS's own that hold no time; of other types nothing is known here."""
    package, _, short = name.replace("/msg/", "/").partition("/")
    if package == "std_msgs":
        return short != "Header"
    if package == "geometry_msgs":
        return not short.endswith("Stamped") and short != "PoseArray"
    return short in _WITHOUT_STAMP.get(package, ())
