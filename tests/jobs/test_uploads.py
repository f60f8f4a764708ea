"""Recordings as files while they are received."""

from __future__ import annotations

import shutil
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from oracle_server.jobs.uploads import RESERVE, FullError, TooLargeError, Uploads


async def pieces(*data: bytes) -> AsyncIterator[bytes]:
    for piece in data:
        yield piece


def left(folder: Path) -> list[Path]:
    return list(folder.iterdir()) if folder.exists() else []


async def test_a_recording_is_kept_until_it_is_removed(tmp_path: Path) -> None:
    kept = Uploads(tmp_path / "r", 2**22)
    path = await kept.receive("a.bag", pieces(b"x" * 2**21, b"y"))
    assert path.read_bytes() == b"x" * 2**21 + b"y"
    await kept.remove(path)
    assert left(tmp_path / "r") == []


@pytest.mark.parametrize("name", ["../../etc/passwd", "/a/b", "..", "", "\n", "ä" * 300, "metadata.yaml"])
async def test_whatever_its_name_it_stands_in_a_folder_of_its_own(name: str, tmp_path: Path) -> None:
    kept = Uploads(tmp_path / "r", 100)
    path = await kept.receive(name, pieces(b"1"))
    assert path.parent.parent == tmp_path / "r"
    assert path.resolve() == path
    assert path.name


async def test_one_that_is_too_large_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(TooLargeError):
        await Uploads(tmp_path / "r", 10).receive("a.bag", pieces(b"12345", b"123456"))
    assert left(tmp_path / "r") == []


async def test_a_disk_that_is_full_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = Uploads(tmp_path / "r", 2**30)
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=RESERVE + 100))
    kept.check_room(100)
    with pytest.raises(FullError, match="256 MiB of it are kept free"):
        kept.check_room(101)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=RESERVE - 1))
    with pytest.raises(FullError):
        await kept.receive("a.bag", pieces(b"x" * 2**20, b"y" * 2**20))
    assert left(tmp_path / "r") == []


async def test_a_write_that_fails_is_told_as_text(tmp_path: Path) -> None:
    (tmp_path / "r").write_text("a file where the folder is to be", encoding="utf-8")
    kept = Uploads(tmp_path / "r" / "s", 100)
    with pytest.raises(FullError, match="can't be written: Not a directory"):
        await kept.receive("a.bag", pieces(b"1"))


def test_what_a_server_left_is_deleted(tmp_path: Path) -> None:
    (tmp_path / "r" / "old").mkdir(parents=True)
    Uploads(tmp_path / "r", 100).clear()
    assert left(tmp_path / "r") == []
