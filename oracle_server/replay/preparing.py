"""A replay of one recording by a spec file, with all that is to be known for it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from oracle_server.core.errors import Finding, FindingKind, SpecError
from oracle_server.core.events import By
from oracle_server.core.hazards.inspection import UNDO_BY_BOTH
from oracle_server.history.views import View
from oracle_server.replay.opening import open_recording
from oracle_server.replay.run import Replay
from oracle_server.rostypes.known import Types
from oracle_server.rostypes.streams import stream_types
from oracle_server.specfiles.document import read_yaml
from oracle_server.specfiles.load import SpecFile, load_spec

_OF_FORMULAS = frozenset[FindingKind]({"vacuous", "unjudged"})
"""The warnings of `check` that tell how much a judgement is worth."""


def doubtful(file: SpecFile) -> list[str]:
    """The warnings of a spec's formulas that tell how much a judgement is worth."""
    return [str(found) for found in file.warnings if found.kind in _OF_FORMULAS]


def read_spec(path: Path, types: Types, by: By | None) -> SpecFile:
    """Read a spec to judge by, in another order than its own where one is given.

    Raises `SpecError` where it can't be used, or not in that order.
    """
    file = load_spec(path, types=types)
    if by == "both" and any(stream.on_deny == "undo" for stream in file.spec.streams):
        document = read_yaml(file.text, str(path))
        undoing = [i for i, stream in enumerate(document.value["streams"]) if stream.get("on_deny") == "undo"]
        places = [document.place(("streams", i, "on_deny")) for i in undoing]
        message = f"{UNDO_BY_BOTH}; leave out `--by both`, or judge by one order"
        raise SpecError([Finding(str(path), *place, message) for place in places])
    return file


def prepare(
    file: SpecFile,
    trace: Path,
    by: By | None,
    folders: Sequence[Path],
    types: Types,
    *,
    strict: bool = False,
    view: View = "standing",
) -> Replay:
    """The replay of a recording by a spec, as `Replay` has it; `types` are those of the `folders`, and others.

    Raises `TraceError` where the recording can't be used.
    """
    recording = open_recording(trace, file.spec, folders)
    shapes, _ = stream_types(file.spec, types, None)
    return Replay(file.spec, recording, by, types=shapes, warnings=doubtful(file), strict=strict, view=view)
