"""Opens a recording in the format that its name and content indicate."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from oracle_server.core.errors import TraceError
from oracle_server.core.spec import Spec
from oracle_server.replay.jsonl import read_lines
from oracle_server.replay.recording import Recording


def open_recording(path: Path, spec: Spec, types: Sequence[Path] = ()) -> Recording:
    """The recording at a path, for one spec; `types` are folders of .msg files. Raises `TraceError`."""
    if path.suffix == ".jsonl":
        return read_lines(path, spec)
    if path.suffix not in (".bag", ".mcap", ".db3") and not path.is_dir():
        raise TraceError(
            f"{path}: is no recording; one is named .jsonl, .bag or .mcap, or is the folder of a ROS 2 bag"
        )
    if not path.exists():
        raise TraceError(f"{path}: can't be read: No such file or directory")
    if path.suffix == ".mcap":
        from oracle_server.replay.mcap import is_trace, read_mcap

        if is_trace(path):
            return read_mcap(path, spec)
    from oracle_server.replay.bags import Bag

    return Bag(path, spec, types)
