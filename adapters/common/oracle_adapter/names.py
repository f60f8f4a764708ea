"""The names that a spec's streams have on this robot.

A spec names streams as one robot without a namespace has them. On a robot of a fleet they are
named otherwise; formulas, history and the wire keep the spec's names.
"""

from __future__ import annotations

import re
from typing import Dict, Iterable

PROXY = "_mon"
"""The suffix of a proxy's name."""
_NAME = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")


class Names:
    """Names of the spec to names on the ROS graph."""

    def __init__(self, remaps: Iterable[str] = (), namespace: str = "") -> None:
        """Take remaps as `/spec_name:=/ros_name`; `namespace` is the prefix of all other names.

        Raises ValueError where one is no such thing.
        """
        self._namespace = "/" + namespace.strip("/") if namespace.strip("/") else ""
        if self._namespace and not _NAME.fullmatch(self._namespace):
            raise ValueError(f"'{namespace}' is no namespace like /uav1")
        self._remaps: Dict[str, str] = {}
        for remap in remaps:
            name, sign, target = remap.partition(":=")
            if not sign or not _NAME.fullmatch(name) or not _NAME.fullmatch(target):
                raise ValueError(f"'{remap}' is no remap like /battery:=/uav1/battery")
            if self._remaps.setdefault(_absolute(name), _absolute(target)) != _absolute(target):
                raise ValueError(f"{name} is remapped twice")

    def __getitem__(self, name: str) -> str:
        """What a name of the spec is on the graph; a proxy's goes with that of what it proxies."""
        name = _absolute(name)
        if name in self._remaps:
            return self._remaps[name]
        proxied = name[: -len(PROXY)]
        if name.endswith(PROXY) and proxied in self._remaps:
            return self._remaps[proxied] + PROXY
        return self._namespace + name

    def unused(self, names: Iterable[str]) -> Iterable[str]:
        """The remapped names that a spec with these names does not have, proxies aside."""
        known = {_absolute(name) for name in names}
        known |= {name + PROXY for name in known}
        return [name for name in self._remaps if name not in known]


def _absolute(name: str) -> str:
    return name if name.startswith("/") else f"/{name}"
