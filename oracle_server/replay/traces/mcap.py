"""A session's trace in an MCAP file: each message of a stream is a line of the trace in JSON.

Beside them are channels that are drawn, and not judged. Where a file is damaged, the record of a channel may be
missing: a line of the trace is known by how it begins.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from oracle_server.core.spec import Spec
from oracle_server.replay.files.mcapfile import MAGIC, McapFile
from oracle_server.replay.recording import Note
from oracle_server.replay.traces.jsonl import Trace

PROFILE = "oracle-server"
_LINE = b'{"stream":'
"""How each line of a trace begins, and no other message."""


def is_trace(path: Path) -> bool:
    """Whether an MCAP file was written of a session, and not by ROS."""
    with path.open("rb") as file:
        return begins_trace(file.read(64))


def begins_trace(head: bytes) -> bool:
    """Whether such a file begins so."""
    return head[len(MAGIC) + 9 :].startswith(len(PROFILE).to_bytes(4, "little") + PROFILE.encode())


def read_mcap(path: Path, spec: Spec) -> Trace:
    """The trace in such a file. Raises OSError; reading it raises `TraceError`."""
    notes: list[Note] = []

    def lines() -> Iterator[tuple[str, bytes]]:
        file = McapFile(path)
        try:
            for number, (_, _, data, *_) in enumerate(file.in_file_order(), start=1):
                if data.startswith(_LINE):
                    yield f"{path}: message {number}", data
        finally:
            file.close()
        notes.extend(Note(f"{path.name}: {damage}", doubt=True) for damage in dict.fromkeys(file.damages))

    return Trace(path, spec, lines, path.stat().st_size, notes=notes)
