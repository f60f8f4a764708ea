"""Packages that this one does not go with, as those of another environment in `PYTHONPATH`, are no defects of it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from packaging.specifiers import SpecifierSet

from oracle_server.cli.unforeseen import is_met
from tests.whole.harness import failed


@pytest.mark.parametrize(
    ("name", "module", "version", "needs"),
    [
        ("pydantic", "pydantic", "1.10.13", "oracle-server needs pydantic>="),
        ("typer", "typer", "0.4.0", "oracle-server needs typer>="),
        ("typing-extensions", "typing_extensions", "4.4.0", " needs typing-extensions>="),
    ],
)
def test_an_old_package_is_named_with_its_place_and_what_to_do(
    tmp_path: Path, name: str, module: str, version: str, needs: str
) -> None:
    """It is read in the place of the one that was installed, and lacks what is imported from there."""
    (tmp_path / f"{module}.py").touch()
    there = tmp_path / f"{module}-{version}.dist-info"
    there.mkdir()
    (there / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n", encoding="utf-8")
    paths = (str(tmp_path), os.environ.get("PYTHONPATH", ""))
    line = failed("--version", PYTHONPATH=os.pathsep.join(filter(None, paths)))
    assert needs in line
    assert f", and finds {name} {version} in {tmp_path}: take {tmp_path} out of PYTHONPATH (" in line
    assert "defect" not in line


VERSIONS = ["1", "1.2", "1.2.0", "1.2.1", "1.10", "2.0", "0.9"]
BOUNDS = [">=1.2", "<2", "==1.2", "!=1.2", "~=1.2", "~=1.2.0", ">1.2", "<=1.2", ">=1.2,<2", ">= 1.2, != 1.10", ""]


@pytest.mark.parametrize("bounds", BOUNDS)
def test_bounds_are_read_as_installers_read_them(bounds: str) -> None:
    assert [is_met(version, bounds) for version in VERSIONS] == [
        version in SpecifierSet(bounds) for version in VERSIONS
    ]


def test_what_can_not_be_read_is_met() -> None:
    assert is_met("1.2", "@ https://example.org/x.whl")
    assert is_met("1.2", "==1.*")
    assert is_met("unknown", ">=1.2")
