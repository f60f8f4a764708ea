"""The specs on hand are the files as they are, whenever these change."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from oracle_server.core.errors import SpecError
from oracle_server.specfiles import library
from oracle_server.specfiles.library import Library, UnknownSpecError, Unsound
from oracle_server.specfiles.load import SpecFile, load_spec

SPEC = "id: x\nstreams:\n  - topic: /a\nproperties:\n  - {id: p, formula: '{v: %s}'}\n"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "x.yaml"
    path.write_text(SPEC % 1)
    return path


def test_a_file_that_changes_while_it_is_read_is_read_again(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def overtaken(read: Path, **given: Any) -> SpecFile:
        found = load_spec(read, **given)
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


# Files that are unsound

UNSOUND = SPEC % 1 + "colour: red\n"


def reasons(specs: Library) -> dict[str, str]:
    """Why files can't be used, by id and file."""
    return {f"{e.id} {e.path.name}": str(e.error) for e in specs.listed() if isinstance(e, Unsound)}


def test_an_unsound_file_is_listed_with_its_reasons_and_hides_no_other(path: Path) -> None:
    (path.parent / "a.yaml").write_text(UNSOUND.replace("id: x", 'id: "a"  # the first'))
    (path.parent / "b.yaml").write_text("id: [")
    (path.parent / "c.yaml").write_bytes(b"\xff\xfe")
    specs = Library(path.parent, path.parent / "uploads")
    assert [e.id for e in specs.listed()] == ["a", "b.yaml", "c.yaml", "x"]
    assert ["a.yaml:6:1" in reasons(specs)["a a.yaml"], "c.yaml:1:1" in reasons(specs)["c.yaml c.yaml"]] == [True, True]
    assert specs.get("x").file.text == SPEC % 1
    assert [*specs.retention()] == ["x"]
    with pytest.raises(SpecError, match="colour"):
        specs.get("a")


def test_an_unsound_file_that_is_mended_is_on_hand(path: Path) -> None:
    bad = path.parent / "b.yaml"
    bad.write_text("id: [")
    specs = Library(path.parent, path.parent / "uploads")
    with pytest.raises(UnknownSpecError):
        specs.get("b")
    bad.write_text(UNSOUND.replace("id: x", "id: b"))
    with pytest.raises(SpecError, match="colour"):
        specs.get("b")
    bad.write_text((SPEC % 1).replace("id: x", "id: b"))
    assert specs.get("b").id == "b"
    assert reasons(specs) == {}


def test_of_two_files_with_one_id_the_first_counts(path: Path) -> None:
    second = path.parent / "y.yaml"
    second.write_text(SPEC % 2)
    specs = Library(path.parent, path.parent / "uploads")
    assert specs.get("x").file.text == SPEC % 1
    reason = f"the id 'x' is that of {path} already; give one of them another id"
    assert reasons(specs) == {"x y.yaml": f"{second}:1:5: {reason}"}
    second.write_text((SPEC % 2).replace("id: x", "id: y"))
    assert specs.get("y").file.text == (SPEC % 2).replace("id: x", "id: y")
    assert reasons(specs) == {}


def test_a_file_whose_id_was_another_one_s_is_on_hand_once_that_is_free(path: Path) -> None:
    second = path.parent / "y.yaml"
    second.write_text(SPEC % 2)
    path.write_text(UNSOUND)
    specs = Library(path.parent, path.parent / "uploads")
    assert len(reasons(specs)) == 2
    path.write_text((SPEC % 1).replace("id: x", "id: z"))
    assert specs.get("x").file.text == SPEC % 2
    assert specs.get("z").path == path
    assert reasons(specs) == {}


def test_an_unsound_file_that_is_gone_is_not_listed(path: Path) -> None:
    path.write_text(UNSOUND)
    specs = Library(path.parent, path.parent / "uploads")
    path.unlink()
    assert specs.listed() == []


def test_an_unsound_upload_goes_before_a_file_and_can_be_put_anew(path: Path, tmp_path: Path) -> None:
    uploads = tmp_path / "uploads"
    uploads.mkdir()
    (uploads / "x.yaml").write_text(UNSOUND)
    specs = Library(path.parent, uploads)
    with pytest.raises(SpecError, match="colour"):
        specs.get("x")
    _, new = specs.put("x", SPEC % 2)
    assert new
    assert specs.get("x").file.text == SPEC % 2
    assert reasons(specs) == {}


# Files that come later


def test_a_new_file_is_on_hand_when_its_spec_is_wanted_or_listed(path: Path) -> None:
    specs = Library(path.parent, path.parent / "uploads")
    (path.parent / "y.yaml").write_text((SPEC % 1).replace("id: x", "id: y"))
    assert specs.get("y").path.name == "y.yaml"
    (path.parent / "z.yml").write_text((SPEC % 1).replace("id: x", "id: z"))
    (path.parent / "bad.yaml").write_text(UNSOUND.replace("id: x", "id: bad"))
    assert [e.id for e in specs.listed()] == ["bad", "x", "y", "z"]
    assert [*reasons(specs)] == ["bad bad.yaml"]


def test_a_pipe_in_the_folder_keeps_no_spec_waiting(path: Path) -> None:
    specs = Library(path.parent, path.parent / "uploads")
    os.mkfifo(path.with_name("pipe.yaml"))
    with pytest.raises(UnknownSpecError):
        specs.get("pipe")
    assert [entry.id for entry in specs.listed()] == ["x"]


def test_a_folder_that_is_made_later_is_read(tmp_path: Path) -> None:
    specs = Library(tmp_path / "specs", tmp_path / "uploads")
    with pytest.raises(UnknownSpecError):
        specs.get("x")
    (tmp_path / "specs").mkdir()
    (tmp_path / "specs" / "x.yaml").write_text(SPEC % 1)
    assert specs.get("x").id == "x"


def test_a_new_file_with_the_id_of_another_one_is_unsound(path: Path) -> None:
    specs = Library(path.parent, path.parent / "uploads")
    (path.parent / "a.yaml").write_text(SPEC % 2)
    assert [*reasons(specs)] == ["x a.yaml"]
    assert specs.get("x").file.text == SPEC % 1


def test_a_file_that_is_renamed_there_and_back_is_that_spec_all_along(path: Path) -> None:
    specs, other = Library(path.parent, path.parent / "uploads"), path.with_name("y.yaml")
    for old, new, value in ((path, other, 2), (other, path, 3)):
        old.rename(new)
        new.write_text(SPEC % value)
        assert specs.get("x").file.text == SPEC % value
        assert [e.path for e in specs.listed()] == [new]


def test_an_unsound_file_that_is_gone_and_comes_again_is_on_hand(path: Path) -> None:
    path.write_text(UNSOUND)
    specs = Library(path.parent, path.parent / "uploads")
    path.unlink()
    assert specs.listed() == []
    path.write_text(SPEC % 1)
    assert specs.get("x").file.text == SPEC % 1


def test_an_upload_goes_before_a_new_file(path: Path) -> None:
    specs = Library(path.parent, path.parent / "uploads")
    specs.put("y", (SPEC % 2).replace("id: x", "id: y"))
    (path.parent / "y.yaml").write_text((SPEC % 1).replace("id: x", "id: y"))
    assert [(e.id, e.source) for e in specs.listed()] == [("x", "file"), ("y", "put")]
    assert reasons(specs) == {}


def test_a_file_that_has_another_id_is_on_hand_by_it(path: Path) -> None:
    specs = Library(path.parent, path.parent / "uploads")
    path.write_text((SPEC % 2).replace("id: x", "id: y"))
    assert specs.get("y").file.text == (SPEC % 2).replace("id: x", "id: y")
    with pytest.raises(SpecError, match="the id was 'x' and has changed"):
        specs.get("x")
    path.write_text(SPEC % 3)
    assert specs.get("x").file.text == SPEC % 3


def test_of_two_files_with_one_id_the_other_counts_once_the_first_is_gone(path: Path) -> None:
    other = path.with_name("z.yaml")
    other.write_text(SPEC % 2)
    specs = Library(path.parent, path.parent / "uploads")
    assert [*reasons(specs)] == ["x z.yaml"]
    path.unlink()
    assert specs.get("x").file.text == SPEC % 2
    assert reasons(specs) == {}
