"""No client of Foxglove has the server's threads wait for each other, whatever the library logs of it."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.processes import PATIENCE, ROOT


@pytest.mark.parametrize("what", ["slow", "unknown channels"])
def test_what_is_logged_of_a_client_stops_nobody(what: str) -> None:
    program = (sys.executable, "-m", "tests.foxglove.alone", what)
    done = subprocess.run(program, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert (done.returncode, done.stdout.splitlines()[-1:]) == (0, ["done"]), done.stderr
    assert ("reads too slowly" in done.stderr) == (what == "slow"), done.stderr
