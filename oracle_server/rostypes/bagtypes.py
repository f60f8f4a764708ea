"""The types by which the messages of bags are decoded, where a bag does not define them itself."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from oracle_server.core.errors import TraceError, one_line
from oracle_server.rostypes.folders import package_of


def typestore(folders: Sequence[Path]) -> Typestore:
    """The types of ROS 2's own packages, and those of the .msg files in folders, each in `PACKAGE/msg/`.

    Raises `TraceError` where a file can't be read.
    """
    store = get_typestore(Stores.LATEST)
    for folder in folders:
        for path in sorted(folder.rglob("*.msg")):
            try:
                types = get_types_from_msg(path.read_text(encoding="utf-8"), f"{package_of(path)}/msg/{path.stem}")
                store.register({name: t for name, t in types.items() if name not in store.fielddefs})
            except Exception as error:  # noqa: BLE001 -- the parser raises anything for a malformed file
                reason = one_line(str(error).strip()) or type(error).__name__
                raise TraceError(f"{path}: can't be read as a message definition: {reason}") from None
    return store
