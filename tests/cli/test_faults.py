"""What goes wrong and was not foreseen is one line and exit status 2: that of 1 says that something was violated."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.processes import ROOT
from tests.whole.harness import COMMAND, environment, failed

SPEC = ROOT / "specs" / "battery_uav.yaml"
TRACE = ROOT / "examples" / "battery_uav" / "traces" / "in_order.jsonl"
FAULTY = TRACE.with_name("fault_wrong_status.jsonl")
REPORTS = [
    ("replay", SPEC, TRACE, "--json"),
    ("replay", SPEC, TRACE, "--format", "junit"),
    ("replay", TRACE, "--on", SPEC, "--format", "csv"),
    ("check", SPEC),
]
DEFECTIVE = """
import sys
from oracle_server.cli import main
import oracle_server.replay.command as command
def run_replay(*_, **__):
    raise TypeError("two\\nlines")
command.run_replay = run_replay
sys.argv[0] = "oracle-server"
main()
"""
STARTING = """
import sys
class CtrlC:
    def find_spec(self, name, *_):
        if name == "typer":
            raise KeyboardInterrupt
sys.meta_path.insert(0, CtrlC())
from oracle_server.cli import main
main()
"""
"""The command, which is ended by Ctrl-C while it reads its modules."""


@pytest.mark.parametrize("command", REPORTS, ids=lambda words: "-".join(str(word).rpartition("/")[2] for word in words))
def test_a_report_that_can_not_be_written_is_no_violation(command: tuple[str | Path, ...]) -> None:
    with Path("/dev/full").open("wb") as full:
        ended = subprocess.run(
            [COMMAND, *command], stdout=full, stderr=subprocess.PIPE, text=True, env=environment(), check=False
        )
    assert ended.returncode == 2
    last = [line for line in ended.stderr.splitlines() if "warning" not in line]
    assert last == ["oracle-server: can't go on: No space left on device"]


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-"])
@pytest.mark.parametrize(("trace", "status"), [(TRACE, 0), (FAULTY, 1), ("/nowhere.jsonl", 2)])
def test_what_is_said_where_nobody_listens_changes_no_exit_status(closed: str, trace: str | Path, status: int) -> None:
    command: list[str | Path] = ["sh", "-c", f'exec "$@" {closed}', "sh", COMMAND, "replay", SPEC, trace]
    ended = subprocess.run(command, capture_output=True, text=True, env=environment(), check=False)
    assert ended.returncode == status, ended
    assert "Traceback" not in ended.stderr
    assert not any(line.startswith("oracle-server: a defect") for line in ended.stderr.splitlines())


@pytest.mark.parametrize("shown", [False, True])
def test_a_defect_is_told_as_one_and_is_no_violation(shown: bool) -> None:
    ended = subprocess.run(
        [sys.executable, *(["-X", "dev"] if shown else []), "-c", DEFECTIVE, "replay", SPEC, TRACE],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if shown:
        assert "Traceback" in ended.stderr
        return
    (line,) = ended.stderr.splitlines()
    assert line.startswith("oracle-server: a defect of oracle-server, please report it: TypeError: two lines (")
    assert ended.returncode == 2


def test_ctrl_c_while_the_modules_are_read_is_no_traceback() -> None:
    """That takes some tenths of a second, and more on a robot."""
    ended = subprocess.run([sys.executable, "-c", STARTING], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "")


def test_that_no_thread_can_be_had_is_told_as_a_limit_and_no_defect() -> None:
    starting = """import resource, threading
    threading.stack_size(2**30)
    resource.setrlimit(resource.RLIMIT_AS, (2**30, 2**30))
    threading.Thread(target=print).start()"""
    limited = DEFECTIVE.replace('raise TypeError("two\\nlines")', starting)
    ended = subprocess.run(
        [sys.executable, "-c", limited, "replay", SPEC, TRACE], capture_output=True, text=True, check=False
    )
    assert ended.stderr.startswith("oracle-server: more threads are needed than there are, "), ended.stderr
    assert ended.returncode == 2


def test_traces_that_were_put_together_are_refused(tmp_path: Path) -> None:
    spec, trace = tmp_path / "spec.yaml", tmp_path / "trace.jsonl"
    spec.write_text(
        "id: x\nstreams: [{topic: /x, signals: {v: msg.v}}]\n"
        "properties: [{id: low, formula: '{topic: \"/x\"} -> {v < 5}'}]\n"
    )
    at = 1_732_147_200 * 10**9
    lines = [
        json.dumps({
            "stream": "/x", "kind": "topic", "stamp": at + n, "arrived": at + n, "monitor": "m", "seq": n,
            "signals": {"v": 1}, "failed": [], **({"begun": at} if n == 1 else {}),
            "places": [{"position": n, "order": "publication", "judged": at + n + 10}],
        }) + "\n"
        for n in range(1, 40)
    ]  # fmt: skip
    for again, twice in ((lines, 1), (lines[-1:], 39), (lines[2:3], 3)):
        trace.write_text("".join(lines + again))
        assert f"has step {twice} twice, or behind a later one" in failed("replay", spec, trace)
    trace.write_text("".join(lines))
    assert subprocess.run([COMMAND, "replay", spec, trace], capture_output=True, check=False).returncode == 0


def test_streams_of_what_is_no_file_are_refused_with_what_it_takes() -> None:
    said = failed("streams", "myrobot")
    assert "there is no file 'myrobot': it takes a spec file, such as specs/battery_uav.yaml." in said
    assert "`GET /api/v1/sessions/ID`" in said
