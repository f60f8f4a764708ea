"""The types by which the messages of bags are decoded, where a bag does not define them itself."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from oracle_server.core.errors import TraceError, one_line
from oracle_server.rostypes.folders import definitions

PARTS = ("Goal", "Result", "Feedback")
"""The parts of an action's definition, in their order."""
NOTHING = ("structure_needs_at_least_one_member", (Nodetype.BASE, ("uint8", 0)))
"""The field of a message without fields, as it is sent."""


def typestore(folders: Sequence[Path]) -> Typestore:
    """The types of files in folders, each in `PACKAGE/msg/` or `PACKAGE/action/`, and those of ROS 2's own packages.

    The first folder that has a type counts: its definition is what the robot has, whatever the newest ROS 2 has. An
    action has three, as `PACKAGE/msg/Name_Goal`. Raises `TraceError` where a file can't be read.
    """
    own: set[str] = set()
    store = get_typestore(Stores.LATEST)
    for folder in folders:
        for path, package in definitions(folder, ("msg", "action")):
            try:
                types = _types_in(path, package)
                _replace(store, {name: t for name, t in types.items() if name not in own})
                own |= types.keys()
            except Exception as error:  # noqa: BLE001 -- the parser raises anything for a malformed file
                reason = one_line(str(error).strip()) or type(error).__name__
                raise TraceError(f"{path}: can't be read as a message definition: {reason}") from None
    return store


def is_given(store: Typestore, name: str) -> bool:
    """Whether a type is there by the definition of a folder: that of ROS 2's own packages is always one object."""
    own = store.fielddefs.get(name)
    return own is not None and own is not get_typestore(Stores.LATEST).fielddefs.get(name)


def _replace(store: Typestore, types: dict[str, Any]) -> None:
    """Register types in the place of others of their names."""
    for name in types:
        store.fielddefs.pop(name, None)
        store.types.pop(name, None)
    store.register(types)


def _types_in(path: Path, package: str) -> dict[str, Any]:
    text, name = path.read_text(encoding="utf-8"), f"{package}/msg/{path.stem}"
    if path.suffix == ".msg":
        return get_types_from_msg(text, name)
    parts = re.split(r"^---[^\S\n]*$", text, flags=re.MULTILINE)
    found: dict[str, Any] = {}
    for part, own in zip(PARTS, parts, strict=True):
        found |= get_types_from_msg(f"{own.strip()}\n", f"{name}_{part}")
        constants, fields = found[f"{name}_{part}"]
        found[f"{name}_{part}"] = constants, fields or [NOTHING]
    return found
