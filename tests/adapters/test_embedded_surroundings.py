"""What surrounds an oracle in the adapter's own process: its log, its settings, oracles elsewhere, older histories."""

from __future__ import annotations

import contextlib
import os
import socket
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest
from oracle_adapter.embedded import EmbeddedLink
from structlog.testing import capture_logs

from oracle_server.history.blocks import SIZE
from tests.adapters.test_embedded import SINGLE, STAMP, guarded
from tests.processes import PATIENCE, environment, eventually

ELSEWHERE = """
id: elsewhere
ordering: {{max_delay: none}}
streams:
  - {{topic: /a, signals: {{v: msg.v}}}}
properties:
  - {{id: small, formula: 'not {{topic: "/a", v > 10}}'}}
  - {{id: far, engine: external, url: 'ws://127.0.0.1:{port}', timeout: 60s}}
"""
ENDED = """
import sys
from oracle_adapter.embedded import EmbeddedLink

with EmbeddedLink(*sys.argv[1:], "m1", session="s", streams=["/a"]) as link:
    link.wait_attached(60)
    for v in range(5):
        link.send("/a", "topic", None, {"v": v})
"""
FULL = """
import sys, threading
from oracle_adapter.embedded import EmbeddedLink, log_warnings

def decision(v):
    return link.ask("/a", "topic", None, {"v": v}, decide_within=60).result(60).decision

log_warnings()
told = threading.Event()
with EmbeddedLink(*sys.argv[1:], "m1", session="s", streams=["/a"], on_violation=lambda _: told.set()) as link:
    link.wait_attached(60)
    print(decision(1), told.wait(60), flush=True)
    database = link._oracle._history.store.database
    for wanted, pages in (("allow", 1), ("deny", 10**6), ("allow", 10**6)):
        while decision(2) != wanted:
            pass
        print(wanted, flush=True)
        database.execute(f"PRAGMA max_page_count = {pages}")
"""


def test_a_log_that_can_not_be_written_changes_nothing(tmp_path: Path) -> None:
    """Violations were told to nobody, and once the history's disk was full, all was denied until the next start."""
    command: list[str | Path] = [sys.executable, "-c", FULL, guarded(tmp_path), tmp_path / "own"]
    with open("/dev/full", "wb") as full:
        ended = subprocess.run(
            command, stdout=subprocess.PIPE, stderr=full, env=environment(), timeout=PATIENCE, check=True
        )
    assert ended.stdout.split(b"\n") == [b"deny True", b"allow", b"deny", b"allow", b""]


def test_what_an_oracle_elsewhere_does_not_answer_is_kept_as_the_adapter_ends(tmp_path: Path) -> None:
    """It was waited for until the process had ended, and all that stood behind it was lost."""
    with socket.create_server(("127.0.0.1", 0)) as mute:
        spec, data = tmp_path / "elsewhere.yaml", tmp_path / "own"
        spec.write_text(ELSEWHERE.format(port=mute.getsockname()[1]))
        command: list[str | Path] = [sys.executable, "-c", ENDED, spec, data]
        subprocess.run(command, env=environment(), timeout=PATIENCE, check=True)
    with contextlib.closing(sqlite3.connect(data / "history.sqlite")) as database:
        assert database.execute("SELECT seq, outcomes FROM steps").fetchall() == [(n, "tu") for n in range(1, 6)]


def test_settings_that_change_nothing_here_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A history that was to be forwarded stayed on the robot, and nobody said so."""
    for name in [name for name in os.environ if name.startswith("ORACLE_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("ORACLE_FORWARD", "postgresql://robot7@centre/oracle")
    monkeypatch.setenv("ORACLE_ALARMS", str(tmp_path / "alarms.yaml"))
    monkeypatch.setenv("ORACLE_RETAIN_AGES", "1h")
    monkeypatch.setenv("ORACLE_RETAIN_SIZE", "1GB")
    with capture_logs() as logs, EmbeddedLink(str(SINGLE), str(tmp_path / "own"), "m1", streams=["/a"]) as link:
        link.wait_attached(PATIENCE)
    told = [log["names"] for log in logs if "ignored" in log["event"]]
    assert told == ["ORACLE_RETAIN_AGES (did you mean ORACLE_RETAIN_AGE?)", "ORACLE_FORWARD, ORACLE_ALARMS"]


def test_timelines_are_made_of_what_an_older_version_has_written(tmp_path: Path) -> None:
    words, blocks = (str(SINGLE), str(tmp_path / "own"), "m1"), "SELECT count(*) FROM blocks"
    with EmbeddedLink(*words, session="s", streams=["/a"]) as link:
        link.wait_attached(PATIENCE)
        for i in range(4 * SIZE):
            assert link.send("/a", "topic", STAMP + i, {"v": i})
        assert link.close(PATIENCE)
    with contextlib.closing(sqlite3.connect(tmp_path / "own" / "history.sqlite", isolation_level=None)) as database:
        (made,) = database.execute(blocks).fetchone()
        database.execute("DELETE FROM blocks")
        with EmbeddedLink(*words, session="s", streams=["/a"]):
            eventually(lambda: database.execute(blocks).fetchone(), lambda there: there == (made,))
