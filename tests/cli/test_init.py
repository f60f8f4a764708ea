"""What `init` writes does what its README says."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest

from tests.whole.harness import COMMAND, failed, run


def test_the_commands_of_the_readme_do_what_it_says(tmp_path: Path) -> None:
    folder = tmp_path / "my_base.2"
    begun = run("init", folder)
    assert begun.returncode == 0
    assert {Path(line).name for line in begun.stdout.splitlines()} == {each.name for each in folder.iterdir()}
    readme = (folder / "README.md").read_text(encoding="utf-8")
    check, replay, serve = re.findall(r"^\$ oracle-server (.*)$", readme, re.MULTILINE)
    checked = in_folder(folder, f"{check} --strict")
    assert (checked.returncode, checked.stdout) == (0, "spec.yaml: sound\n")
    judged = in_folder(folder, replay)
    assert judged.returncode == 1
    assert {line.split()[0] for line in judged.stdout.splitlines() if " currently_" in line} == {"keeps_clear", "sees"}
    assert len(re.findall(r"^violation: ", judged.stdout, re.MULTILINE)) == 3
    assert serve == "serve --specs ."
    assert "ROBOT" not in readme
    assert "id: my_base.2\n" in (folder / "spec.yaml").read_text(encoding="utf-8")


def in_folder(folder: Path, words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([COMMAND, *words.split()], check=False, cwd=folder, capture_output=True, encoding="utf-8")


def test_nothing_that_is_there_is_written_over(tmp_path: Path) -> None:
    (tmp_path / "spec.yaml").write_text("mine", encoding="utf-8")
    assert "is something in it" in failed("init", tmp_path)
    assert [each.name for each in tmp_path.iterdir()] == ["spec.yaml"]


@pytest.mark.parametrize("name", ["a b", "ü", "x" * 65])
def test_a_name_that_no_spec_can_have_is_told(name: str, tmp_path: Path) -> None:
    assert "can't be the spec's name: take letters from a to z, digits" in failed("init", tmp_path / name)
    assert not (tmp_path / name).exists()


def test_a_folder_that_can_not_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert "can't be written" in failed("init", tmp_path / "file" / "base")
    assert os.listdir(tmp_path) == ["file"]


@pytest.mark.parametrize("options", [[], ["--examples"]])
def test_a_folder_that_was_begun_on_a_full_disk_is_begun_anew_by_the_same_command(
    options: list[str], tmp_path: Path
) -> None:
    command = [str(COMMAND), "init", *options, str(tmp_path / "base")]
    full = ["bash", "-c", 'ulimit -f 4; exec "$@"', "bash", *command]  # no file gets longer than 4 KiB
    ended = subprocess.run(full, check=False, capture_output=True, encoding="utf-8")
    assert (ended.returncode, "can't be written: File too large" in ended.stderr) == (2, True), ended.stderr
    assert os.listdir(tmp_path / "base") == []
    assert subprocess.run(command, check=False, capture_output=True).returncode == 0
