"""What works where neither POSIX nor reelay is: specs are checked, and recordings judged, on Windows too."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from oracle_server.core.errors import SpecError
from oracle_server.engines import reelay
from oracle_server.specfiles.load import parse_spec
from tests.processes import ROOT

ELSEWHERE = """
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name in {"fcntl", "grp", "pwd", "reelay", "resource", "syslog", "termios", "uvloop"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Missing())
from oracle_server.cli import main
sys.argv[0] = "oracle-server"
main()
"""
SPEC = """id: s
streams:
  - topic: /a
properties:
  - id: p
    engine: {engine}
    formula: 'not {{data: 1}}'
"""


def elsewhere(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return program("-c", ELSEWHERE, *arguments)


def program(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *map(str, arguments)], check=False, capture_output=True, text=True)


def test_specs_are_checked_and_recordings_judged() -> None:
    spec, trace = ROOT / "specs/battery_uav.yaml", ROOT / "examples/battery_uav/traces/fault_wrong_status.jsonl"
    checked = elsewhere("check", spec)
    assert (checked.returncode, checked.stderr.count("Traceback")) == (0, 0)
    judged = elsewhere("replay", spec, trace)
    here = program("-m", "oracle_server", "replay", spec, trace)
    assert (judged.returncode, judged.stdout) == (here.returncode, here.stdout)
    assert judged.returncode == 1


def test_a_server_is_refused_in_a_line(tmp_path: Path) -> None:
    served = elsewhere("serve", "--data-dir", tmp_path, "--port", "0")
    assert served.returncode == 2
    assert served.stderr.count("\n") == 1
    assert "Linux" in served.stderr


def test_a_running_server_is_read() -> None:
    read = elsewhere("sessions", "--url", "http://127.0.0.1:1")
    assert read.returncode == 2
    assert "can't be reached" in read.stderr


@pytest.mark.parametrize("engine", ["reelay", "both"])
def test_where_reelay_is_not_installed_the_spec_is_refused_and_says_what_to_write(
    engine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reelay, "find_spec", lambda _: None)
    with pytest.raises(SpecError) as refused:
        parse_spec(SPEC.format(engine=engine), "s")
    (finding,) = refused.value.findings
    assert "engine: native" in finding.message
