"""What needs an extra that is not installed says so."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from oracle_server.extras import install
from tests.processes import PATIENCE
from tests.replay.many.recordings import write_recordings, write_specs

WITHOUT = """
import sys
sys.modules[sys.argv.pop(1)] = None
from oracle_server.cli import main
if __name__ == "__main__":
    main()
"""


def replay(missing: str, *words: object) -> str:
    """What the command says where a package is missing."""
    ended = subprocess.run(
        [sys.executable, "-c", WITHOUT, missing, "replay", *map(str, words)],
        capture_output=True, text=True, timeout=PATIENCE, check=False,
    )  # fmt: skip
    assert (ended.returncode, ended.stdout) == (2, "")
    return ended.stderr


def test_the_extra_is_named(tmp_path: Path) -> None:
    (spec, _), (recording,) = write_specs(tmp_path), write_recordings(tmp_path / "r", 1)
    assert replay("ray", recording, "--on", spec, "--engine", "ray") == (
        f"oracle-server: --engine ray needs the package ray; install it: `{install('ray')}`, on each "
        "machine of the cluster; -j needs nothing\n"
    )
    assert replay("pyarrow", recording, "--on", spec, "--out", tmp_path / "a.parquet") == (
        f"oracle-server: --out {tmp_path / 'a.parquet'}: Parquet needs the package pyarrow; install it: "
        f"`{install('parquet')}`; .jsonl and .csv need nothing\n"
    )
