"""Processes that judge recordings: one that dies or never ends stops no other."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import threading
from pathlib import Path, PosixPath
from typing import Any, Literal

import pytest

from oracle_server.replay.many.judging import Task, Unit
from oracle_server.replay.many.row import Row
from oracle_server.replay.many.workers import Ended, Workers
from tests.replay.many.recordings import judged, question, write_recordings, write_specs
from tests.whole.harness import COMMAND

AGES = 600.0


class Deadly(PosixPath):
    """A recording that kills whoever looks at it, as Linux does where memory is short."""

    def is_dir(self) -> Literal[False]:
        os.kill(os.getpid(), signal.SIGKILL)
        return False


class Endless(PosixPath):
    """A recording that takes for ever."""

    def is_dir(self) -> Literal[False]:
        threading.Event().wait()
        return False


class Odd(PosixPath):
    """A recording that raises what nobody has thought of."""

    def is_dir(self) -> Literal[False]:
        raise ZeroDivisionError("what is this?")


class Failing(PosixPath):
    """A recording on a disk that fails once its digest is taken."""

    opened = 0

    def open(self, *arguments: Any, **options: Any) -> Any:
        self.opened += 1
        if self.opened > 1:
            raise OSError(errno.EIO, "Input/output error")
        return super().open(*arguments, **options)


def run(recordings: list[Path], specs: list[Path], timeout: float | None = AGES) -> dict[int, list[Row]]:
    """The rows of each recording, of two processes."""
    asked, found = question(specs), dict[int, list[Row]]()
    every = tuple(range(len(specs)))
    tasks = [Task(i, path, every) for i, path in enumerate(recordings)]
    ended = []
    for said in Workers(asked, 2, timeout).run(tasks):
        if isinstance(said, Unit):
            assert said.task not in ended
            found.setdefault(said.task, []).extend(said.rows)
        elif isinstance(said, Ended):
            ended.append(said.task)
    assert sorted(ended) == list(range(len(recordings)))
    return found


def test_processes_judge_as_this_one_does(tmp_path: Path) -> None:
    specs, recordings = write_specs(tmp_path), write_recordings(tmp_path / "recordings", 10)
    found = run(recordings, specs)
    for i, path in enumerate(recordings):
        assert found[i] == judged(question(specs), path)


def test_nothing_is_taken_from_the_folder_that_it_is_run_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bags come from others, and are looked at where they were unpacked."""
    specs, recordings = write_specs(tmp_path), write_recordings(tmp_path / "recordings", 1)
    for name in ("struct.py", "queue.py", "yaml.py"):
        (tmp_path / "recordings" / name).write_text("raise SystemExit('this is not what is meant')\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path / "recordings")
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    ended = subprocess.run(
        [COMMAND, "replay", *recordings, "--on", specs[0], "-j", "2", "--format", "jsonl"],
        capture_output=True, encoding="utf-8", check=False,
    )  # fmt: skip
    rows = [json.loads(line) for line in ended.stdout.splitlines()]
    assert [row["error"] for row in rows] == [None] * len(rows), ended
    assert rows
    assert ended.stderr == ""


def test_a_process_that_is_killed_is_an_error_of_its_recording(tmp_path: Path) -> None:
    specs, recordings = write_specs(tmp_path), write_recordings(tmp_path / "recordings", 4)
    found = run([recordings[0], Deadly(recordings[1]), Deadly(recordings[2]), recordings[3]], specs)
    for i in (0, 3):
        assert found[i] == judged(question(specs), recordings[i])
    for i in (1, 2):
        assert [row.property for row in found[i]] == ["below_three", "slows", "rises"]
        for row in found[i]:
            assert row.error == (
                f"{recordings[i]}: the process that judged it was killed, as Linux does where memory is short"
            )
            assert (row.error_kind, row.exit, row.outcome, row.recording_digest) == ("run", 2, None, None)


def test_a_recording_that_takes_for_ever_is_an_error(tmp_path: Path) -> None:
    specs, recordings = write_specs(tmp_path)[:1], write_recordings(tmp_path / "recordings", 3)
    found = run([Endless(recordings[0])], specs, timeout=0.1)
    assert {row.error for row in found[0]} == {f"{recordings[0]}: took longer than 0.1 s (--timeout)"}


def test_what_nobody_has_thought_of_is_an_error(tmp_path: Path) -> None:
    specs, recordings = write_specs(tmp_path), write_recordings(tmp_path / "recordings", 2)
    found = run([Odd(recordings[0]), recordings[1]], specs)
    assert {row.error_kind for row in found[0]} == {"run"}
    assert all("ZeroDivisionError: what is this?" in (row.error or "") for row in found[0])
    assert found[1] == judged(question(specs), recordings[1])


def test_what_the_system_does_not_let_be_read_is_tried_again(tmp_path: Path) -> None:
    """It is no matter of what the recording holds, and so no result."""
    specs, (path, *_) = write_specs(tmp_path), write_recordings(tmp_path / "recordings", 1)
    (rows,) = run([Failing(path)], specs).values()
    assert {(row.error, row.error_kind, row.recording_digest) for row in rows} == {
        (f"{path}: can't be read: Input/output error", "run", None)
    }
