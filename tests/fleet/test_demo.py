"""`./scripts/demo fleet` shows what it says, and ends by itself."""

from __future__ import annotations

import re
import subprocess
import sys

from tests.postgres import needed
from tests.processes import PATIENCE, ROOT


def test_nothing_is_lost_where_a_server_is_killed() -> None:
    needed()
    shown = subprocess.run(
        [sys.executable, "-m", "tests.fleet.demo"],
        check=False, cwd=ROOT, capture_output=True, text=True, timeout=3 * PATIENCE,
    )  # fmt: skip
    assert shown.returncode == 0, shown.stdout + shown.stderr
    assert re.search(r"kill -9 of ([abc]), while they drive\n   (?!\1)[abc] has taken over robot1", shown.stdout)
    assert shown.stdout.count("400 acked, 400 kept, each once; 200 decisions told, 200 of them kept so") == 2
    assert "-m tests.fleet.demo" in (ROOT / "scripts" / "demo").read_text()
