"""Machines drawn by `check`, and written by `import`."""

from __future__ import annotations

import json
from pathlib import Path

from tests.whole.harness import run

MODES = Path(__file__).parents[2] / "examples" / "modes" / "modes.yaml"


def test_a_drawn_machine_is_written_by_import_again(tmp_path: Path) -> None:
    ended = run("check", MODES, "--mermaid", "--json")
    drawn = [each for each in map(json.loads, ended.stdout.splitlines()) if "mermaid" in each]
    assert [(each["file"], each["machine"]) for each in drawn] == [(str(MODES), "modes"), (str(MODES), "lease")]
    diagram = tmp_path / "modes.mmd"
    diagram.write_text(drawn[0]["mermaid"])
    ended = run("import", "--diagram", diagram)
    assert ended.returncode == 1  # where the mode comes from is left to be written
    assert '      "AUTO": ["IDLE", "FAULT"]\n' in ended.stdout
    assert "nothing was imported that judges anything" in ended.stderr
    shown = run("check", MODES, "--mermaid").stdout
    assert drawn[0]["mermaid"] in shown
    assert f"{MODES}: sound" in shown


def test_what_can_not_be_imported_is_told_with_its_line(tmp_path: Path) -> None:
    diagram = tmp_path / "modes.dot"
    diagram.write_text("digraph {\n  A -- B\n}")
    ended = run("import", "--diagram", diagram)
    assert ended.returncode != 0
    assert f"{diagram}:2: an arrow of a digraph is `->`" in ended.stderr
    assert "Traceback" not in ended.stderr
