"""What an extra needs is installed where the server is: the `pip` of the shell may install elsewhere."""

from __future__ import annotations

import shlex
import subprocess
import sys

import pytest

from oracle_server import extras
from tests.processes import PATIENCE


def test_it_is_installed_by_this_python() -> None:
    """Nothing is installed: pip says what it would do, and has this package already."""
    command = shlex.split(extras.install("postgres"))
    assert command[0] == sys.executable
    said = subprocess.run(
        [*command, "--dry-run", "--no-deps", "--no-index"],
        capture_output=True, text=True, timeout=PATIENCE, check=False,
    )  # fmt: skip
    assert "Requirement already satisfied: oracle-server" in said.stdout, said


def test_without_pip_it_is_installed_by_uv_which_makes_such_environments(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extras, "find_spec", lambda _: None)
    monkeypatch.setattr(sys, "executable", "/home/a b/python")
    assert extras.install("ray") == "uv pip install --python '/home/a b/python' 'oracle-server[ray]'"
