"""Folders of bags that were packed by tar are judged as the folders are."""

from __future__ import annotations

import io
import os
import sys
import tarfile
from pathlib import Path

import pytest
from rosbags.rosbag2 import StoragePlugin

from oracle_server.core.errors import TraceError
from tests.replay.judging import judge, write_numbers, write_spec
from tests.replay.test_folders import SPEC, TOPICS


def pack(folder: Path, path: Path, form: int = tarfile.PAX_FORMAT) -> Path:
    with tarfile.open(path, "w", format=form) as packed:
        packed.add(folder, arcname=folder.name)
    return path


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    return write_spec(tmp_path, SPEC)


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    return write_numbers(tmp_path / "bag", TOPICS, StoragePlugin.SQLITE3)


@pytest.mark.parametrize("form", [tarfile.USTAR_FORMAT, tarfile.PAX_FORMAT])
def test_a_packed_folder_is_judged_as_the_folder(form: int, spec: Path, bag: Path) -> None:
    found = judge(spec, pack(bag, bag.with_suffix(".tar"), form))
    plain = judge(spec, bag)
    assert (found.summary["events"], found.exit, found.strict) == (20, 0, 0)
    assert found.said == plain.said


def test_what_lies_outside_is_written_inside(spec: Path, bag: Path, tmp_path: Path) -> None:
    path = tmp_path / "odd.tar"
    with tarfile.open(path, "w") as packed:
        for file in bag.iterdir():
            packed.add(file, arcname=f"../../{file.name}")
        link = tarfile.TarInfo("link.db3")
        link.type, link.linkname = tarfile.SYMTYPE, "/etc/passwd"
        packed.addfile(link)
    before = sorted(tmp_path.rglob("*"))
    assert judge(spec, path).summary["events"] == 20
    assert sorted(tmp_path.rglob("*")) == before


def test_what_can_not_be_unpacked_is_said(spec: Path, bag: Path, tmp_path: Path) -> None:
    path = pack(bag, tmp_path / "cut.tar")
    path.write_bytes(path.read_bytes()[:6_000])
    with pytest.raises(TraceError, match=r"cut\.tar: (can't be unpacked|ends within)"):
        judge(spec, path)
    path = tmp_path / "twice.tar"
    with tarfile.open(path, "w") as packed:
        for folder in ("a", "b"):
            packed.addfile(tarfile.TarInfo(f"{folder}/metadata.yaml"), io.BytesIO())
    with pytest.raises(TraceError, match=r"twice\.tar: has two files of the name metadata\.yaml"):
        judge(spec, path)
    path = tmp_path / "other.tar"
    with tarfile.open(path, "w") as packed:
        packed.addfile(tarfile.TarInfo("readme.txt"), io.BytesIO())
    with pytest.raises(TraceError, match=r"other\.tar: can't be read as a bag: it has no metadata\.yaml"):
        judge(spec, path)


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are texts")
@pytest.mark.parametrize("packed", [False, True])
def test_names_that_are_no_utf_8_are_read(packed: bool, spec: Path, bag: Path, tmp_path: Path) -> None:
    """As those of an old machine, or of an archive that was packed on one."""
    (file,) = bag.glob("*.db3")
    folder = tmp_path / os.fsdecode(b"m\xe4rz")
    folder.mkdir()
    file.rename(folder / os.fsdecode(b"m\xe4rz.db3"))
    found = judge(spec, pack(folder, tmp_path / "bag.tar", tarfile.GNU_FORMAT) if packed else folder)
    assert (found.summary["events"], found.exit) == (20, 0)


def heading(name: str, kind: bytes, size: bytes) -> bytes:
    """The heading of a file as nobody packs it, its size as it is to stand there."""
    found = bytearray(tarfile.TarInfo(name).tobuf(tarfile.USTAR_FORMAT))
    found[124:136], found[156:157], found[148:156] = size.ljust(12, b"\0"), kind, b" " * 8
    found[148:156] = b"%06o\0 " % sum(found)
    return bytes(found)


BELOW = b"\xff" * 10 + b"\xfe\x00"
"""-512, as GNU writes what octal digits can't."""


@pytest.mark.parametrize("kind", [b"0", b"Z"])
def test_a_size_below_0_has_an_end(kind: bytes, spec: Path, tmp_path: Path) -> None:
    """The next file was the one itself, for ever."""
    path = tmp_path / "back.tar"
    path.write_bytes(heading(".first", b"0", b"0") + heading(".again", kind, BELOW) + bytes(1024))
    with pytest.raises(TraceError, match=r"back\.tar: can't be unpacked: "):
        judge(spec, path)


@pytest.mark.parametrize(("kind", "body"), [(b"L", b"name\0"), (b"x", b"9 a=bcde\n")])
def test_headings_without_number_before_a_file_are_said(kind: bytes, body: bytes, spec: Path, tmp_path: Path) -> None:
    path = tmp_path / "many.tar"
    one = heading("long", kind, b"%o" % len(body)) + body.ljust(512, b"\0")
    path.write_bytes(one * 5_000 + heading("bag.db3", b"0", b"0") + bytes(1024))
    with pytest.raises(TraceError, match=r"many\.tar: can't be unpacked: too many headers stand before a file"):
        judge(spec, path)


def test_a_file_without_a_name_is_passed_over(spec: Path, tmp_path: Path) -> None:
    path = tmp_path / "nameless.tar"
    path.write_bytes(heading("/", b"0", b"0") + bytes(1024))
    with pytest.raises(TraceError, match=r"nameless\.tar: has no files"):
        judge(spec, path)
