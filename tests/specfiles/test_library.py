"""The specs on hand are the files as they are, whenever these change."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from oracle_server.specfiles import library
from oracle_server.specfiles.library import Library
from oracle_server.specfiles.load import SpecFile, load_spec

SPEC = "id: x\nstreams:\n  - topic: /a\nproperties:\n  - {id: p, formula: '{v: %s}'}\n"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "x.yaml"
    path.write_text(SPEC % 1)
    return path


def test_a_file_that_changes_while_it_is_read_is_read_again(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def overtaken(read: Path) -> SpecFile:
        found = load_spec(read)
        path.write_text(SPEC % 2, encoding="utf-8")
        return found

    monkeypatch.setattr(library, "load_spec", overtaken)
    specs = Library(path.parent, path.parent / "uploads")
    monkeypatch.undo()
    assert specs.get("x").file.text == SPEC % 2


def test_a_file_that_is_replaced_within_one_tick_of_the_file_system_is_read_again(path: Path) -> None:
    specs = Library(path.parent, path.parent / "uploads")
    draft, times = path.with_suffix(".draft"), path.stat()
    draft.write_text(SPEC % 2)
    os.utime(draft, ns=(times.st_atime_ns, times.st_mtime_ns))
    draft.replace(path)
    assert specs.get("x").file.text == SPEC % 2


def test_a_file_that_is_gone_is_known_as_it_was(path: Path) -> None:
    specs = Library(path.parent, path.parent / "uploads")
    path.unlink()
    assert specs.get("x").file.text == SPEC % 1


def test_a_spec_that_was_put_is_on_the_disk_before_that_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whole before it has its name, and then the name: what was answered outlives the machine's power."""
    synced: list[tuple[str, object]] = []

    def sync(handle: int) -> None:
        path = Path(os.readlink(f"/proc/self/fd/{handle}"))
        there = sorted(p.name for p in path.iterdir()) if path.is_dir() else path.read_bytes().decode()
        synced.append((path.name, there))

    monkeypatch.setattr(os, "fsync", sync)
    specs = Library(None, tmp_path / "data" / "specs")
    text = SPEC % 1 + "description: über\n"
    specs.put("x", text)
    assert synced == [("data", ["specs"]), ("x.draft", text), ("specs", ["x.yaml"])]
    synced.clear()
    specs.put("x", SPEC % 2)
    assert synced == [("x.draft", SPEC % 2), ("specs", ["x.yaml"])]
