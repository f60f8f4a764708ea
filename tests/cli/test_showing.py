"""`replay --serve` shows a recording in the dashboard, and leaves nothing behind."""

from __future__ import annotations

import re
import signal
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from oracle_server.cli.showing import show_recording
from oracle_server.core.errors import TraceError
from tests.processes import PATIENCE, ROOT, Process
from tests.whole.harness import COMMAND, STRICT, environment, failed

SPEC, FAULT = ROOT / "examples/rover/rover.yaml", ROOT / "examples/rover/traces/fault.jsonl"


@pytest.fixture
def showing(tmp_path: Path) -> Iterator[Process]:
    """With settings of a server of one's own, which are not those of this one."""
    settings = environment(
        **STRICT, TMPDIR=str(tmp_path), ORACLE_TOKENS="/nowhere", ORACLE_HISTORY="postgresql://x@127.0.0.1:1/x"
    )
    process = Process("the command", [COMMAND, "replay", "--serve", SPEC, FAULT], settings)
    try:
        yield process
    finally:
        process.remove()


def test_a_recording_is_looked_at_until_ctrl_c(showing: Process, tmp_path: Path) -> None:
    url = showing.said(r"(http://127\.0\.0\.1:\d+)/#/sessions/rover: \d+ events, 3 violations")[1]
    showing.said("Ctrl-C ends it")
    with httpx.Client(base_url=url, timeout=PATIENCE, trust_env=False) as http:
        assert "<title>" in http.get("/").raise_for_status().text
        state = http.get("/api/v1/sessions/rover").json()
        assert (state["kind"], state["recording"]["complete"]) == ("recording", True)
        assert len(http.get("/api/v1/sessions/rover/violations").json()["items"]) == 3
    assert list(tmp_path.iterdir()) != []
    assert showing.end(signal.SIGINT) == 1  # as `replay` ends with
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(httpx.ConnectError):
        httpx.get(url, trust_env=False)
    assert "Traceback" not in showing.log


def test_what_can_not_be_judged_is_told_and_leaves_nothing(tmp_path: Path) -> None:
    other = tmp_path / "other.jsonl"
    other.write_text('{"topic": "/odom", "time": 10}\n', encoding="utf-8")
    (tmp_path / "temporary").mkdir()
    told = failed("replay", "--serve", SPEC, other, TMPDIR=str(tmp_path / "temporary"))
    assert re.search(r"other\.jsonl: has no event of rover", told)
    assert list((tmp_path / "temporary").iterdir()) == []


def test_folders_of_several_files_are_refused(tmp_path: Path) -> None:
    for name in ("a.mcap", "b.mcap"):
        (tmp_path / name).touch()
    with pytest.raises(TraceError, match="takes one file, and it has 2"):
        show_recording([SPEC], tmp_path, [])


def test_other_options_are_refused() -> None:
    assert "leave out all other options" in failed("replay", "--serve", "--strict", SPEC, FAULT)
