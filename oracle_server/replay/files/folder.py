"""The folder of a ROS 2 bag: its files, and what its metadata says of them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO

import yaml
import zstandard

from oracle_server.core.errors import TraceError
from oracle_server.core.units import counted
from oracle_server.replay.files.blocks import ZSTD
from oracle_server.replay.files.mcapfile import MAGIC as MCAP
from oracle_server.replay.files.mcapfile import McapFile
from oracle_server.replay.files.ros1file import MAGIC as ROS1
from oracle_server.replay.files.ros1file import Ros1File
from oracle_server.replay.files.scratch import let_go, unpacking, write
from oracle_server.replay.files.sqlitefile import MAGIC as SQLITE
from oracle_server.replay.files.sqlitefile import SqliteFile
from oracle_server.replay.files.storage import Storage
from oracle_server.replay.files.strangers import is_named, is_named_compressed, why_no_file_of_a_bag
from oracle_server.replay.traces.mcap import begins_trace, is_trace

_KINDS: dict[bytes, Callable[[Path], Storage]] = {MCAP: McapFile, SQLITE: SqliteFile, ROS1: Ros1File}
MAGICS = (*_KINDS, ZSTD)
"""How the files of bags begin."""
METADATA = "metadata.yaml"
"""The file that makes a folder a bag of ROS 2."""
_MOST_TIMES = 8
"""How often over a file may be compressed."""
_LARGEST = 2**26
"""The most bytes of metadata."""
_NAMED = 5
"""Files of a folder that are told by their names."""
_LEFT_OUT = 1_000
"""The most parts of a bag that may be missing between others: of more they are not the parts of one."""


@dataclass(slots=True)
class Files:
    """The files of a bag, in the order of recording; without metadata in that of the numbers in their names.

    Those that the metadata names are among them where they are missing, too, and so are those that the numbers of the
    others leave out; `missing` says so of one. `promised` are the numbers of messages by topic that it has, None
    without metadata; `notes` says what is wrong with the bag as a whole.
    """

    paths: list[Path]
    promised: Counter[str] | None = None
    notes: list[str] = field(default_factory=list)
    missing: str = ""


def files_of(path: Path) -> Files:
    """The files of a bag, which is a file or a folder. Raises `TraceError` where there are none."""
    if not path.is_dir():
        return Files([path], notes=_as_part(path))
    metadata = path / METADATA
    if not metadata.exists():
        inside = sorted((p for p in path.iterdir() if p.is_file()), key=_by_numbers)
        found = [p for p in inside if is_named(p) or begins_as(p) is not None]  # the others are told of once opened
        if not found:
            raise TraceError(f"{path}: can't be read as a bag: it has no {METADATA}, and no files of messages")
        # a recorder that compresses files and was killed may leave one beside what it was compressing it to
        files = _undescribed([file for file in found if _plain(file) == file or _plain(file) not in found])
        files.notes += [
            f"{p.name}: {why_no_file_of_a_bag(p)}" for p in inside if is_named_compressed(p) and p not in found
        ]
        files.notes += _further(path)
        return files
    return _listed(path, _information(metadata))


def _as_part(path: Path) -> list[str]:
    """What is said of a file that is one of several of a bag: what the others have was not heard."""
    folder = path.absolute().parent
    try:
        if (folder / METADATA).is_file():
            named = {_plain(file).name for file in _named(folder, _information(folder / METADATA))}
        else:
            numbered = (file for file in folder.iterdir() if file.name.startswith(f"{folder.name}_"))
            found = [file for file in numbered if file.is_file() and begins_as(file) in (MCAP, SQLITE, ZSTD)]
            named = {_plain(file).name for file in _parts(found) or ()} if found else set()
    except (OSError, TraceError):  # it is no bag that could be judged instead
        return []
    if len(named) < 2 or _plain(path).name not in named:
        return []
    what = f"is one of the {len(named)} files of a bag, and the others were not judged"
    return [f"{path.name}: {what}: name its folder, {path.parent if path.parent.name else folder}"]


def _further(folder: Path) -> list[str]:
    """What is said of recordings in the folders of one without metadata, which are not judged with its own files."""
    names = [path.name for path in sorted(folder.iterdir()) if path.is_dir() and _has_recording(path)]
    if not names:
        return []
    named = f"{', '.join(names[:_NAMED])}{', …' if len(names) > _NAMED else ''}"
    what = f"has recordings in {counted(len(names), 'folder')}, which are not judged with its files"
    return [f"{what}; with --on each is one of its own: {named}"]


def _has_recording(folder: Path) -> bool:
    """Whether a folder is a bag, or has files of bags."""
    try:
        return any(p.name == METADATA or (p.is_file() and begins_as(p) is not None) for p in folder.iterdir())
    except OSError:  # it can't be read
        return False


def _undescribed(found: list[Path]) -> Files:
    """The files of a folder without metadata, which bags of ROS 1 have none of."""
    own = "with --on each is one of its own"
    if {begins_as(file) for file in found} - {None} == {ROS1}:
        split = f"has {len(found)} bags of ROS 1, which are judged as one that was split; {own}"
        return Files(found, notes=[split] if len(found) > 1 else [])
    parts = _parts(found)
    if parts is None:
        names = f"{', '.join(file.name for file in found[:_NAMED])}{', …' if len(found) > _NAMED else ''}"
        others = f"has {len(found)} files that are not numbered as the parts of one bag, and no {METADATA}"
        return Files(found, notes=[f"{others}: they are judged as one; {own}: {names}"])
    notes = [f"has no {METADATA}: its recording was not closed"]
    return Files(parts, notes=notes, missing="is missing, by the numbers of the others")


def _parts(found: list[Path]) -> list[Path] | None:
    """The files of one bag in the order of their numbers, with those that are left out; None where they are of several.

    What was deleted before the first, as by a recorder that keeps the last ones, is not known to have been there.
    """
    if len(found) == 1:
        return found
    numbered: dict[int, Path] = {}
    alike = set()
    for file in found:
        plain = _plain(file)
        name, _, number = plain.stem.rpartition("_")
        if not re.fullmatch("[0-9]{1,9}", number) or int(number) in numbered:
            return None
        numbered[int(number)] = file
        alike.add((name, plain.suffix))
    first, last = min(numbered), max(numbered)
    if len(alike) > 1 or last - first > _LEFT_OUT + len(found):
        return None
    ((name, suffix),) = alike
    return [numbered.get(at, found[0].with_name(f"{name}_{at}{suffix}")) for at in range(first, last + 1)]


def open_storage(path: Path, stack: ExitStack, times: int = 0) -> Storage:
    """One file of a bag, opened by what it begins with, until `stack` is closed. Raises `TraceError` and OSError.

    So many `times` it was decompressed before.
    """
    magic = begins_as(path)
    if magic == ZSTD:
        if times == _MOST_TIMES:
            raise TraceError(f"{path}: is compressed more than {_MOST_TIMES} times over, which no bag is")
        _refuse_other(path)
        folder = stack.enter_context(unpacking(path))
        plain = folder / path.name.removesuffix(".zstd")
        damage = _unpack(path, plain)
        try:
            storage = open_storage(plain, stack, times + 1)
        except TraceError as error:
            raise TraceError(str(error).replace(str(plain), str(path))) from None
        storage.damages += damage
        let_go(folder)
        return storage
    if magic is None:
        raise TraceError(f"{path}: {why_no_file_of_a_bag(path)}")
    storage = _KINDS[magic](path)
    stack.callback(storage.close)
    return storage


def begins_as(path: Path) -> bytes | None:
    """What a file begins with, of what files of bags begin with. Raises OSError."""
    with path.open("rb") as file:
        return _magic(file.read(32))


def _magic(head: bytes) -> bytes | None:
    return next((magic for magic in MAGICS if head.startswith(magic)), None)


def _refuse_other(path: Path) -> None:
    """Raise `TraceError` where a compressed file holds none of a bag; before the disk is filled with what it holds."""
    try:
        with path.open("rb") as packed:
            head = _reader(packed).read(64)
    except zstandard.ZstdError:  # told where it is decompressed
        return
    if head and (_magic(head) is None or begins_trace(head)):
        what = "is compressed, and holds no file of a bag"
        raise TraceError(f"{path}: {what}: decompress it (`zstd -d {path.name}`), and judge what comes out")


def _reader(packed: BinaryIO) -> zstandard.ZstdDecompressionReader:
    return zstandard.ZstdDecompressor(max_window_size=2**27).stream_reader(packed, read_across_frames=True)


def _information(path: Path) -> dict[str, Any]:
    """What stands in metadata. Raises `TraceError`."""
    try:
        text = path.read_text(encoding="utf-8") if path.stat().st_size <= _LARGEST else ""
        document = yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))  # noqa: S506 -- both are safe
        found = document["rosbag2_bagfile_information"]
    except (OSError, ValueError, TypeError, LookupError, RecursionError, yaml.YAMLError):
        found = None
    if not isinstance(found, dict):
        raise TraceError(f"{path}: can't be read as the metadata of a bag; without it the folder's files can be")
    return found


def _by_numbers(path: Path) -> list[str | int]:
    """A name by which `bag_10` comes behind `bag_9`: its texts, and the numbers between them."""
    return [int(part) if at % 2 else part for at, part in enumerate(re.split("([0-9]+)", path.name))]


def _named(folder: Path, information: dict[str, Any]) -> list[Path]:
    """The files that metadata names. Raises `TraceError` where it names none."""
    names = information.get("relative_file_paths")
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        raise TraceError(f"{folder / METADATA}: names no files")
    return [folder / _base(name) for name in names]


def _listed(folder: Path, information: dict[str, Any]) -> Files:
    named = _named(folder, information)
    paths = [*dict.fromkeys(map(_as_it_is, named))]  # none is read twice
    if not any(path.is_file() for path in paths):
        names = ", ".join(map(str, information["relative_file_paths"]))
        raise TraceError(f"{folder}: none of the files that {METADATA} names is there: {names}")
    notes = [f"{path.name}: is not named in {METADATA}, and was not judged" for path in _beside(folder, paths)]
    return Files(paths, Counter(dict(_promised(information))), notes, f"is missing, which {METADATA} names")


def _beside(folder: Path, named: Sequence[Path]) -> Iterator[Path]:
    """The files of a folder that are as those which are named, but for copies of these that are compressed or not."""
    suffixes, known = {_plain(path).suffix for path in named}, {_plain(path) for path in named}
    for path in sorted(folder.iterdir(), key=_by_numbers):
        alike = _plain(path).suffix in suffixes and _plain(path) not in known
        if alike and path.is_file() and begins_as(path) in MAGICS and not is_trace(path):
            yield path


def _base(name: str) -> str:
    """The name of a file, of that in metadata, before which old ROS has folders (by backslashes on Windows)."""
    return PurePosixPath(name.replace("\\", "/")).name


def _as_it_is(path: Path) -> Path:
    """A file that metadata names; where that is not there a copy, which was compressed since or is so no more."""
    plain = _plain(path)
    copies = (plain, plain.with_name(f"{plain.name}.zstd"), plain.with_name(f"{plain.name}.zst"))
    return next((copy for copy in (path, *copies) if copy.is_file()), path)


def _plain(path: Path) -> Path:
    return path.with_name(path.name.removesuffix(".zstd").removesuffix(".zst"))


def _promised(information: dict[str, Any]) -> Iterator[tuple[str, int]]:
    for entry in information.get("topics_with_message_count") or ():
        match entry:
            case {"topic_metadata": {"name": str(name)}, "message_count": int(count)}:
                yield name, count


def _unpack(path: Path, plain: Path) -> list[str]:
    """Decompress a file; returns what was wrong with it. Raises `TraceError` where nothing does, and `NoRoomError`."""
    try:
        with path.open("rb") as packed:
            write(_reader(packed), plain, path)
        with path.open("rb") as packed:
            size = zstandard.frame_content_size(packed.read(18))
    except zstandard.ZstdError:
        size = -1
    there = plain.stat().st_size
    if not there:
        raise TraceError(f"{path}: could not be decompressed")
    return ["ends early: it could not be decompressed to its end"] if there < size else []
