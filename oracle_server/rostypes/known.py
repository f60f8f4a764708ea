"""The types that are known here: of folders that are named, of what is sourced, and of ROS's standard packages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Literal

from oracle_server.core.hazards.ros import Ros
from oracle_server.core.kinds import ACTION
from oracle_server.core.nearest import nearest
from oracle_server.core.shapes import Many, Record, Shape, Unknown, Value, ValueKind
from oracle_server.core.typed import Missing, TypedMessage
from oracle_server.rostypes import standard
from oracle_server.rostypes.definition import PRIMITIVES, Fields
from oracle_server.rostypes.events import event_fields, service_of
from oracle_server.rostypes.folders import PARTS, Workspace, read_folder
from oracle_server.rostypes.others import is_well_known

_KINDS: Mapping[str, ValueKind] = {
    "bool": "bool", "string": "text", "wstring": "text", "float32": "real", "float64": "real"
}  # fmt: skip
_BYTES = frozenset({"uint8", "char", "byte"})
_TIMES = frozenset({"builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"})
_QUATERNION = "geometry_msgs/msg/Quaternion"
_DEEPEST = 64
_BELONGS = {
    "msg": ("a message", "topic"), "srv": ("a service", "service"), "action": ("an action", ACTION)
}  # fmt: skip
"""What people call the definitions of each kind, and the key of the streams that have them."""
_Of = Literal["newest", "any", "every"]
"""Which fields: those of the newest definition, those that some definition has, or those that every one has alike."""


class Types:
    """ROS types by name, for one version of ROS or for all.

    The folders come first, then what is sourced, then the standard packages. A folder's definition is what the robot
    has; of the others a robot may have an older or newer one.
    """

    def __init__(self, folders: Sequence[Path] = (), environment: Mapping[str, str] | None = None) -> None:
        """Read the folders; of `environment`, by default the process's, what is sourced. Raises `TypesError`."""
        self._own: dict[str, Fields] = {}
        for folder in folders:
            for name, fields in read_folder(folder).items():
                self._own.setdefault(name, fields)
        self._sourced = Workspace(environment)

    def message(self, name: str, ros: Ros | None = None) -> TypedMessage | Missing:
        """A message by its full name, as `pkg/msg/Name` or `pkg/srv/Name_Request`; or why it is not known."""
        found = self._variants(name, ros)
        if not found:
            return self._missing(name)
        shape, everywhere = self._record(name, found, ros, "newest"), self._record(name, found, ros, "every")
        # what a folder defines is what the robot has
        anywhere = shape if name in self._own else self._record(name, found, ros, "any")
        unknown = tuple(dict.fromkeys([*_unknown_in(shape), *_unknown_in(anywhere)]))
        return TypedMessage(
            shape, None if anywhere == shape else anywhere, None if everywhere == shape else everywhere, unknown
        )

    def _variants(self, name: str, ros: Ros | None) -> list[Fields]:
        service = service_of(name) if ros != 1 else ""
        if service:
            return [event_fields(service)] if self._variants(f"{service}_Request", ros) else []
        if name in self._own:
            return [self._own[name]]
        sourced = self._sourced.types(name.partition("/")[0]).get(name)
        given = [] if sourced is None else [sourced]
        known = list(standard.variants(name, ros))
        if "/action/" in name and ros != 2:
            known += standard.variants(_on_ros1(name), 1)
        return given + known if ros is None else known + given

    def _nested(self, name: str, ros: Ros | None, which: _Of, around: tuple[str, ...]) -> Record | Unknown:
        """A message within others, `around` it; one that stands in itself is none."""
        found = self._variants(name, ros) if name not in around and len(around) <= _DEEPEST else []
        return self._record(name, found, ros, which, around) if found else Unknown(name)

    def _record(
        self, name: str, found: Sequence[Fields], ros: Ros | None, which: _Of, around: tuple[str, ...] = ()
    ) -> Record:
        fields: dict[str, str] = {}
        for variant in found if which == "any" else found[:1]:
            fields = {**variant, **fields}
        if which == "every":
            fields = {f: kind for f, kind in fields.items() if all(v.get(f) == kind for v in found)}
        shapes = {field: self._shape(kind, ros, which, (*around, name)) for field, kind in fields.items()}
        if name in _TIMES and (ros == 1 or (ros is None and which == "any")):
            shapes |= {"secs": Value("whole", "int32"), "nsecs": Value("whole", "int32")}
        if name == _QUATERNION:
            shapes = {f: replace(of, unit=True) if isinstance(of, Value) else of for f, of in shapes.items()}
        return Record(_written(name), shapes)

    def _shape(self, kind: str, ros: Ros | None, which: _Of, around: tuple[str, ...]) -> Shape:
        of, is_list, size = kind.partition("[")
        if is_list and of in _BYTES and not (of == "byte" and ros == 1):
            return Value("bytes", kind, may_be_list=of == "byte" and ros is None)
        primitive = of in PRIMITIVES
        single = Value(_KINDS.get(of, "whole"), of) if primitive else self._nested(of, ros, which, around)
        if not is_list:
            return single
        return Many(single, int(size[:-1]) if size[:-1] else None)

    # What is not known

    @cached_property
    def _packages(self) -> frozenset[str]:
        names = {name.partition("/")[0] for name in (*self._own, *standard.names())}
        return frozenset(names) | frozenset(self._sourced.packages)

    def _of_package(self, package: str) -> Iterator[str]:
        """The names of a package's messages, and of the parts of its services and actions."""
        for name in (*self._own, *self._sourced.types(package), *standard.names()):
            if name.startswith(f"{package}/"):
                yield name

    def _missing(self, name: str) -> Missing:
        if service_of(name):
            return self._no_events(name, f"{service_of(name)}_Request")
        type_ = _written(name)
        package, kind, short = type_.split("/")
        if name in self._sourced.types(package):
            why = next((w for p, w in self._sourced.unreadable.items() if f"/{short}." in p), f"it is no .{kind} file")
            return Missing(f"the definition of {type_} can't be read, so its fields are not checked: {why}", "warning")
        if package not in self._packages:
            near = "" if is_well_known(package) else nearest(package, self._packages, alike=0.85)
            who = f"the package {package} is not known here{f' ({near})' if near else ''}"
            return Missing(f"{who}, so the fields of its types are not checked; {_HOW}", "warning", package)
        known = {_written(other) for other in self._of_package(package)}
        for other_kind, (is_now, key) in _BELONGS.items():
            other = f"{package}/{other_kind}/{short}"
            if other_kind != kind and other in known:
                return Missing(f"{type_} is not there, and {other} is {is_now}: it belongs to a `{key}`", "error")
        shorts = {n.rpartition("/")[2] for n in known if f"/{kind}/" in n}
        if not shorts:
            return Missing(f"{type_} is not known here, so its fields are not checked; {_HOW}", "warning")
        half = _written(f"{package}/srv/{short}").rpartition("/")[2]
        hint = (
            f"did you mean `{half}`?"
            if half in shorts
            else nearest(short, shorts) or "give the folder of a newer one with --types"
        )
        return Missing(f"the package {package} has no {kind} '{short}'; {hint}", "error")

    def _no_events(self, name: str, request: str) -> Missing:
        """Why the events of a service are not known, whose requests have this name."""
        if not self._variants(request, None):
            return self._missing(request)
        no_events = f"there is no {name} on ROS 1, where services tell nothing of their calls"
        return Missing(f"{no_events}; observe the service itself, by the key `service`", "error")


def _unknown_in(shape: Shape) -> Iterator[str]:
    match shape:
        case Unknown(name):
            yield name
        case Many(of):
            yield from _unknown_in(of)
        case Record(_, fields):
            for inner in fields.values():
                yield from _unknown_in(inner)


def unknown_within(name: str) -> str:
    """What is said of a type of a field that is not known."""
    return f"the type {name} of a field is not known here, so what stands in it is not checked; {_HOW}"


_HOW = "give the folder of its package with --types, or source the workspace"


def _written(name: str) -> str:
    """The name as a spec has it: the parts of a service or action by the whole."""
    for part in PARTS.get(name.split("/")[1], ()):
        name = name.removesuffix(part)
    return name


def _on_ros1(name: str) -> str:
    """A part of an action, as `pkg/action/Name_Goal`, by the name of its message on ROS 1."""
    return "".join(name.replace("/action/", "/msg/").rsplit("_", 1))
