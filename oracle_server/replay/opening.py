"""Opens a recording in the format that its content indicates, whatever it is named."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from oracle_server.core.errors import NotReadError, TraceError
from oracle_server.core.spec import Spec
from oracle_server.replay.files.packed import is_packed
from oracle_server.replay.files.strangers import instead, what_it_is
from oracle_server.replay.recording import Recording
from oracle_server.replay.traces.line import MAX_LINE, read_line

_HEAD = 4096
_OF_SPECS = frozenset({".yaml", ".yml"})
_NEITHER = (
    "is no recording: neither a bag of ROS 1 or ROS 2, nor a log in JSON Lines; what is in another format, as CSV, is "
    'written as one event a line first: {"stream": "/odom", "stamp": 1700000000000000000, "data": {"x": 1.5}}'
)
_MARK = b"\xef\xbb\xbf"
"""How some editors begin a file of UTF-8."""


def open_recording(path: Path, spec: Spec, types: Sequence[Path] = ()) -> Recording:
    """The recording at a path, for one spec; `types` are folders of .msg files. Raises `TraceError`."""
    try:
        if path.is_dir() and path.suffix != ".jsonl":
            from oracle_server.replay.bags.bag import Bag

            return Bag(path, spec, types)
        if path.exists() and not path.is_file():
            raise TraceError(f"{path}: is no file, and a recording is read more than once: write it to one first")
        with path.open("rb") as file:
            head = file.read(_HEAD)
        return _by_content(path, head, spec, types)
    except OSError as error:
        why = f"{error.strerror}{'' if path.exists() else instead(path)}"
        raise NotReadError(f"{path}: can't be read: {why}") from None


def refuse_swapped(specs: Sequence[Path], recording: Path) -> None:
    """Raise `TraceError` where a recording stands among the specs, or a spec in the place of the recording."""
    from oracle_server.replay.files.folder import METADATA

    if stray := [path for path in specs if is_recording(path)]:
        among = stray[0]
        what = f"{among}: is a recording, and stands where a spec is expected"
        others = [path for path in (*specs, recording) if path != among]
        if len(stray) == 1 and len(others) == len(specs) and not is_recording(recording):
            raise TraceError(f"{what}; write `replay {' '.join(map(str, others))} {among}`")
        raise TraceError(f"{what}: `replay SPEC… RECORDING`; many recordings: `replay RECORDING… --on SPEC…`")
    if recording.name == METADATA and recording.is_file():
        raise TraceError(f"{recording}: is the metadata of a bag; name its folder: {recording.parent}")
    if is_spec(recording):
        raise TraceError(
            f"{recording}: is a spec, and stands where the recording is expected: `replay SPEC… RECORDING`"
        )


def is_spec(path: Path) -> bool:
    """Whether a file is a spec by its name, and no recording."""
    return path.suffix in _OF_SPECS and path.is_file() and not is_recording(path)


def is_recording(path: Path) -> bool:
    """Whether something is certainly a recording, by what it begins with; of a pipe nothing is read, as it is gone."""
    from oracle_server.replay.files.folder import MAGICS, METADATA

    try:
        if path.is_dir():
            return (path / METADATA).exists()
        if not path.is_file():
            return False
        with path.open("rb") as file:
            head = file.readline(MAX_LINE)
    except OSError:
        return False
    try:
        return is_packed(head) or any(head.startswith(magic) for magic in MAGICS) or bool(read_line(head))
    except ValueError:
        return False


def _by_content(path: Path, head: bytes, spec: Spec, types: Sequence[Path]) -> Recording:
    from oracle_server.replay.files.folder import MAGICS
    from oracle_server.replay.traces.jsonl import read_lines

    if any(head.startswith(magic) for magic in MAGICS):
        from oracle_server.replay.bags.bag import Bag
        from oracle_server.replay.traces.mcap import is_trace, read_mcap

        return read_mcap(path, spec) if is_trace(path) else Bag(path, spec, types)
    if head and (what := what_it_is(head)):
        raise TraceError(f"{path}: {what}")
    if path.suffix == ".jsonl" or head.removeprefix(_MARK).lstrip().startswith(b"{"):
        return read_lines(path, spec)
    if is_packed(head):
        from oracle_server.replay.bags.bag import Bag

        return Bag(path, spec, types)
    raise TraceError(f"{path}: {_NEITHER if head else what_it_is(head)}")
