"""The server's log, written by a process of its own: what logs is the whole process."""

from __future__ import annotations

import json
import os
import stat
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import pytest

from oracle_server.process.logs import KEPT, MAX_SIZE
from oracle_server.process.seldom import Seldom
from tests.processes import PATIENCE, environment

LOGS = """
import logging, sys
from pathlib import Path
import structlog
from oracle_server.process.logs import set_up_logs
from oracle_server.process.settings import Settings

set_up_logs(Settings(log=sys.argv[1], log_file=Path(sys.argv[2]) if sys.argv[2:] else None))
log = structlog.get_logger()
"""


def written(program: str, *arguments: object) -> str:
    """Log by a program, and tell what stands on its standard error."""
    command = [sys.executable, "-c", LOGS + program, *map(str, arguments)]
    ended = subprocess.run(command, capture_output=True, timeout=PATIENCE, env=environment(), check=True)
    assert ended.stdout == b""
    return ended.stderr.decode()


def test_a_full_log_is_put_aside_and_the_oldest_of_them_goes(tmp_path: Path) -> None:
    file = tmp_path / "new" / "server.log"
    written("for number in range(70): log.info(f'{number:02}' + 1_000_000 * '.')", "json", file)
    names = [f"server.log.{age}" for age in range(KEPT, 0, -1)] + ["server.log"]
    assert sorted(path.name for path in file.parent.iterdir()) == sorted(names)
    assert all(file.with_name(name).stat().st_size <= MAX_SIZE for name in names)
    text = "".join(file.with_name(name).read_text(encoding="utf-8") for name in names)
    kept = [int(json.loads(line)["event"][:2]) for line in text.split("\n")[:-1]]
    assert kept[-1] == 69
    assert all(b == a + 1 for a, b in pairwise(kept))
    assert len(text) > KEPT * 0.9 * MAX_SIZE
    assert stat.S_IMODE(file.parent.stat().st_mode) == 0o700


def test_a_pipe_is_refused_where_nobody_reads_it_and_written_where_somebody_does(tmp_path: Path) -> None:
    """To open one that nobody reads would wait, without an end and a word."""
    file = tmp_path / "pipe"
    os.mkfifo(file)
    with pytest.raises(subprocess.CalledProcessError) as refused:
        written("", "json", file)
    assert b"pipe: can't be written as log: it is a pipe that nobody reads" in refused.value.stderr
    with open(os.open(file, os.O_RDONLY | os.O_NONBLOCK), encoding="utf-8") as reader:
        written("log.info('said')", "json", file)
        assert json.loads(reader.read())["event"] == "said"


def test_all_that_is_logged_is_json_where_that_is_asked_for(tmp_path: Path) -> None:
    program = (
        "log.info('ours', text='ü\\u2028')\n"
        "log.debug('not logged')\n"
        "logging.getLogger('theirs').info('not logged')\n"
        "logging.getLogger('theirs').warning('%s', 'odd\\ud800')\n"
        "try: 1 / 0\n"
        "except ZeroDivisionError: log.exception('a bug')\n"
    )
    written(program, "json", tmp_path / "log")
    lines = [json.loads(line) for line in (tmp_path / "log").read_text(encoding="utf-8").split("\n")[:-1]]
    assert [(line["event"], line["level"]) for line in lines] == [
        ("ours", "info"),
        ("odd\ud800", "warning"),
        ("a bug", "error"),
    ]
    assert lines[0]["text"] == "ü\u2028"
    assert "ZeroDivisionError" in lines[2]["exception"]
    assert all(line["timestamp"].endswith("Z") for line in lines)


def test_without_a_file_the_log_is_on_standard_error_for_people() -> None:
    said = written("log.info('ours', n=1); logging.getLogger('theirs').error('of a library')", "console")
    ours, theirs = said.split("\n")[:-1]
    assert "[info" in ours
    assert ours.endswith("n=1")
    assert "[error" in theirs
    assert "of a library" in theirs


def test_a_disk_that_is_full_costs_lines_and_nothing_else() -> None:
    program = "for _ in range(3): log.info('lost'); logging.getLogger('theirs').error('lost too')"
    assert written(program, "json", "/dev/full") == ""


HOSTILE = "a\x1b[2Jb\x07c\r\n2026-01-01 [error    ] forged\u2028d\u202ee"


def test_what_others_say_begins_no_line_and_commands_no_terminal(tmp_path: Path) -> None:
    program = (
        f"text = {HOSTILE!r}\n"
        "log.warning('ours', reason=text, list=[text])\n"
        "log.warning(text)\n"
        "logging.getLogger('theirs').warning(text)\n"
        "try: raise ValueError(text)\n"
        "except ValueError: log.exception('a bug')\n"
    )
    written(program, "console", tmp_path / "log")
    text = (tmp_path / "log").read_text(encoding="utf-8")
    assert all(char.isprintable() for char in text.replace("\n", ""))
    lines = text.split("\n")[:-1]
    assert sum("forged" in line for line in lines) >= 4
    assert not any(line.startswith("2026-01-01") for line in lines)
    assert [line.startswith("  ") for line in lines[:5]] == [False] * 4 + [True]


def test_what_libraries_say_of_clients_is_logged_once_a_second(tmp_path: Path) -> None:
    program = (
        "for number in range(1000):\n"
        "    logging.getLogger('uvicorn.error').warning('Invalid HTTP request received.')\n"
        "    logging.getLogger('asyncio').warning('socket %s', number)\n"
        "log.info('whole')\n"
    )
    written(program, "console", tmp_path / "log")
    text = (tmp_path / "log").read_text(encoding="utf-8")
    assert 1 <= text.count("Invalid HTTP request received.") < 100
    assert 1 <= text.count("socket") < 100
    assert text.count("whole") == 1


def test_a_cause_is_told_again_with_how_often_it_came(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 10.0
    monkeypatch.setattr(time, "monotonic", lambda: now)
    seldom = Seldom()
    assert [seldom.due("a") for _ in range(5)] == [1, 0, 0, 0, 0]
    assert seldom.due("b") == 1
    now += 1
    assert seldom.due("a") == 5
    assert seldom.due("a") == 0


def test_who_does_not_read_the_log_stops_nothing_and_is_told_what_was_lost() -> None:
    program = (
        "for number in range(20_000): log.info(f'{number:05}' + 100 * '.')\n"
        "print('went on', flush=True)\n"
        "sys.stdin.readline()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", LOGS + program, "json"],
        env=environment(), text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    ) as process:  # fmt: skip
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline() == "went on\n"
        process.stdin.write("end\n")
        process.stdin.flush()
        lines = [json.loads(line) for line in process.stderr]
    assert process.returncode == 0
    assert len(lines) < 20_000
    *kept, told = [line["event"] for line in lines]
    numbers = [int(line[:5]) for line in kept]  # what is taken while the pipe has room makes room for later ones
    assert numbers == sorted(set(numbers))
    assert numbers[:1_000] == list(range(1_000))
    assert told == f"{20_000 - len(kept)} lines of the log were lost: it was not written in time"


def test_a_process_ends_though_nobody_reads_its_log() -> None:
    program = "for _ in range(2_000): log.info(100 * '.')\nlog.error('the last one')\n"
    with subprocess.Popen(
        [sys.executable, "-c", LOGS + program, "json"], env=environment(), stderr=subprocess.PIPE
    ) as process:
        assert process.wait(PATIENCE) == 0
