"""A command that is told to end does so, whatever it is at."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.processes import PATIENCE

WHILE_COLLECTING = """\
import gc, signal, threading
from oracle_server.process.ending import ended_as_by_ctrl_c

def told(phase, info):
    gc.callbacks.remove(told)
    signal.raise_signal(signal.NUMBER)

with ended_as_by_ctrl_c():
    gc.callbacks.append(told)
    gc.collect()
    threading.Event().wait()
print("went on")
"""


def run(program: str) -> subprocess.CompletedProcess[str]:
    """Run it to its end, for which it does not need as long as it may have."""
    words = [sys.executable, "-c", program]
    return subprocess.run(words, capture_output=True, encoding="utf-8", check=False, timeout=PATIENCE)


@pytest.mark.parametrize(("number", "status"), [("SIGTERM", 143), ("SIGHUP", 129), ("SIGINT", -2)])
def test_a_signal_that_comes_while_garbage_is_collected_is_not_lost(number: str, status: int) -> None:
    """Python drops what is raised within the collector, and the command went on, deaf to SIGTERM from then on."""
    program = WHILE_COLLECTING.replace("NUMBER", number)
    ended = run(program)
    assert (ended.returncode, ended.stdout) == (status, "")
    assert "Exception ignored" not in ended.stderr


@pytest.mark.parametrize(("number", "status"), [("SIGTERM", 143), ("SIGINT", -2)])
def test_one_that_comes_again_before_python_has_dropped_it_is_not_lost(number: str, status: int) -> None:
    """As on a machine with much to do, on which it was told again that soon; a second one is dropped likewise."""
    busy = f"""\
import signal, threading
begin = threading.Thread.start

def start(thread):
    begin(thread)
    signal.raise_signal(signal.{number})

threading.Thread.start = start
"""
    ended = run(busy + WHILE_COLLECTING.replace("NUMBER", number))
    assert (ended.returncode, ended.stdout) == (status, "")
    assert "Exception ignored" not in ended.stderr


def test_what_else_python_drops_is_told_as_ever() -> None:
    program = WHILE_COLLECTING.replace("signal.raise_signal(signal.NUMBER)", "raise ValueError('a defect')")
    program = program.replace("threading.Event().wait()", "pass")
    went_on = run(program)
    assert (went_on.returncode, went_on.stdout) == (0, "went on\n")
    assert "Exception ignored" in went_on.stderr
    assert "a defect" in went_on.stderr
