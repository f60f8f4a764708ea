"""The pid file of a data directory."""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from oracle_server.process import pidfile
from oracle_server.process.pidfile import NAME, PidFile, PidFileError, running
from tests.processes import PATIENCE


def meanwhile(monkeypatch: pytest.MonkeyPatch, act: Callable[[], object]) -> None:
    """Have something happen where it waits, instead of that time passing; other threads sleep as ever."""
    monkeypatch.setattr(pidfile, "time", SimpleNamespace(monotonic=time.monotonic, sleep=lambda _: act()))


def test_who_looks_whether_a_server_runs_keeps_none_from_starting(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    PidFile(tmp_path).release()
    with (tmp_path / NAME).open() as looked_at:
        fcntl.flock(looked_at, fcntl.LOCK_SH)
        meanwhile(monkeypatch, lambda: fcntl.flock(looked_at, fcntl.LOCK_UN))
        mine = PidFile(tmp_path)
    assert running(tmp_path) == (os.getpid(), None, False)
    mine.release()


def test_a_server_that_has_not_told_yet_who_it_is_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its pid is needed to stop it, and 0 would be everyone in the caller's own group."""
    mine = PidFile(tmp_path)
    (tmp_path / NAME).write_text("")
    meanwhile(monkeypatch, lambda: mine.publish("http://127.0.0.1:1"))
    assert running(tmp_path) == (os.getpid(), "http://127.0.0.1:1", False)
    mine.release()


def test_an_adapter_that_is_ending_is_waited_for_and_a_server_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pidfile, "_WITHIN", -1.0)
    ending = PidFile(tmp_path, embedded=True)
    with pytest.raises(PidFileError, match="uses this data directory"):
        PidFile(tmp_path, embedded=True)
    meanwhile(monkeypatch, ending.release)
    mine = PidFile(tmp_path, embedded=True, wait=PATIENCE)
    assert running(tmp_path) == (os.getpid(), None, True)
    mine.release()
    server = PidFile(tmp_path)
    meanwhile(monkeypatch, server.release)
    with pytest.raises(PidFileError, match="uses this data directory"):
        PidFile(tmp_path, embedded=True, wait=PATIENCE)
    server.release()


def test_a_data_directory_that_is_a_file_is_told_in_words(tmp_path: Path) -> None:
    """The system's number of the error, and the path once more, stood there."""
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(PidFileError) as error:
        running(file)
    assert str(error.value) == f"{file / NAME}: can't be read: Not a directory; --data-dir names a folder"


def test_a_pipe_in_its_place_is_told(tmp_path: Path) -> None:
    """To open it would wait for who writes to it, without an end."""
    os.mkfifo(tmp_path / NAME)
    for use in (running, PidFile):
        with pytest.raises(PidFileError, match=r"server\.pid: is a pipe"):
            use(tmp_path)
