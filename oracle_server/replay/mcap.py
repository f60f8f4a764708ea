"""A session's trace as an MCAP file: a channel for each stream, whose messages are the lines of the trace in JSON."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import msgspec
from mcap.writer import Writer

from oracle_server.core.kinds import KINDS
from oracle_server.core.spec import Spec
from oracle_server.replay.jsonl import Trace
from oracle_server.replay.mcapfile import MAGIC, McapFile
from oracle_server.replay.recording import Note

PROFILE = "oracle-server"
_SCHEMA = b'{"type": "object"}'


def write_mcap(path: Path, lines: Iterable[dict[str, Any]]) -> int:
    """Write the lines of a session's trace; returns how many. Raises OSError."""
    written = 0
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile=PROFILE, library="oracle-server")
        schema = writer.register_schema("oracle_server.Event", "jsonschema", _SCHEMA)
        channels: dict[tuple[str, str], int] = {}
        for line in lines:
            stream = line["stream"], line["kind"]
            if stream not in channels:
                traits = KINDS.get(line["kind"])
                name = line["stream"] if traits and traits.sole else f"{line['stream']}/{line['kind']}"
                channels[stream] = writer.register_channel(name, "json", schema, {"kind": line["kind"]})
            writer.add_message(channels[stream], line["arrived"], msgspec.json.encode(line), line["stamp"], line["seq"])
            written += 1
        writer.finish()  # type: ignore[no-untyped-call]
    return written


def is_trace(path: Path) -> bool:
    """Whether an MCAP file was written by `write_mcap`, and not by ROS."""
    with path.open("rb") as file:
        head = file.read(64)
    return head[len(MAGIC) + 9 :].startswith(len(PROFILE).to_bytes(4, "little") + PROFILE.encode())


def read_mcap(path: Path, spec: Spec) -> Trace:
    """The trace in a file that `write_mcap` wrote. Raises OSError; reading it raises `TraceError`."""
    notes: list[Note] = []

    def lines() -> Iterator[tuple[str, bytes]]:
        file = McapFile(path)
        try:
            for number, (_, _, data) in enumerate(file.in_file_order(), start=1):
                yield f"{path}: message {number}", data
        finally:
            file.close()
        notes.extend(Note(f"{path.name}: {damage}", doubt=True) for damage in dict.fromkeys(file.damages))

    return Trace(path, spec, lines, path.stat().st_size, notes=notes)
