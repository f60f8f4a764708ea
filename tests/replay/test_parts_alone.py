"""A file that is one of several of a bag, and is judged alone."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import yaml
from rosbags.rosbag2 import StoragePlugin

from tests.replay.judging import judge, write_numbers, write_spec
from tests.replay.test_folders import BOTH, SPEC, TOPICS


@pytest.mark.parametrize("described", [True, False])
@pytest.mark.parametrize("storage", BOTH)
def test_one_of_several_files_of_a_bag_is_said_to_be_no_more(
    storage: StoragePlugin, described: bool, tmp_path: Path
) -> None:
    """What the others have was not heard: of what was `once` there is nothing to be known."""
    bag, spec = write_numbers(tmp_path / "bag", TOPICS, storage), write_spec(tmp_path, SPEC)
    (part,) = (path for path in bag.iterdir() if path.name != "metadata.yaml")
    first, second = (part.with_name(f"bag_{at}{part.suffix}") for at in (0, 1))
    part.rename(first)
    shutil.copy(first, second)
    document = yaml.safe_load((bag / "metadata.yaml").read_text())
    document["rosbag2_bagfile_information"]["relative_file_paths"] = [first.name, second.name]
    (bag / "metadata.yaml").write_text(yaml.safe_dump(document))
    if not described:
        (bag / "metadata.yaml").unlink()
    found = judge(spec, second)
    said = f"{second.name}: is one of the 2 files of a bag, and the others were not judged: name its folder, {bag}"
    assert (found.exit, found.strict, found.said) == (0, 3, said)
