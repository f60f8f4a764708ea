"""Two specs with one id, as two versions of one: what was found is told of the file of which it is."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from oracle_server.replay.command import run_replay
from oracle_server.replay.many.command import run_many

SPEC = """
id: speed
streams: [{{topic: /v, signals: {{v: msg.v}}}}]
properties:
{room}  - {{id: low, formula: '{{topic: "/v"}} -> {{v < {limit}}}'}}
"""


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """A spec that is violated, another of the same id that is not, and the recording."""
    monkeypatch.setenv("COLUMNS", "1000")  # so that no line is broken
    paths = [tmp_path / "strict.yaml", tmp_path / "lax.yaml", tmp_path / "trace.jsonl"]
    paths[0].write_text(SPEC.format(limit=5, room="\n\n"))
    paths[1].write_text(SPEC.format(limit=50, room=""))
    lines = [{"stream": "/v", "stamp": n, "arrived": n, "data": {"v": 9}} for n in range(1, 4)]
    paths[2].write_text("".join(json.dumps(line) + "\n" for line in lines))
    return paths


@pytest.mark.parametrize("turned", [False, True])
def test_a_violation_is_marked_in_its_own_file(
    turned: bool, files: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    *specs, trace = files
    assert run_replay(specs[::-1] if turned else specs, trace, None, "github") == 1
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith(f"::error file={specs[0]},line=7,")


def test_a_table_of_many_tells_them_apart(files: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    *specs, trace = files
    assert run_many([trace], specs) == 1
    said, *_ = lines = capsys.readouterr().out.splitlines()
    assert said.startswith(f"{trace}: speed ({specs[0]}): low: 1 violation,")
    assert [line.split() for line in lines[-2:]] == [
        ["speed", f"({path})", "low", "1", violated, violations, violated, "0", "0"]
        for path, violated, violations in ((specs[0], "1", "1"), (specs[1], "0", "0"))
    ]


def test_so_does_one_whose_results_are_there_by_another_name(
    files: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    *specs, trace = files
    assert run_many([trace], specs, out=tmp_path / "table.jsonl") == 1
    before = capsys.readouterr().out
    moved = [path.rename(path.with_stem(f"{path.stem}_new")) for path in specs]
    assert run_many([trace], moved, out=tmp_path / "table.jsonl") == 1
    renamed = before.replace("strict.", "strict_new.").replace("lax.", "lax_new.")
    assert capsys.readouterr().out.split() == renamed.split()
