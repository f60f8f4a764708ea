"""A signal that comes while the adapter waits for the master."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import pytest

from tests.ros1.harness import Scene

WITHIN_A_DESTRUCTOR = """
import os, signal, sys, time
from oracle_ros1.stopping import Stopping

class Left:
    def __del__(self):
        os.kill(os.getpid(), int(sys.argv[1]))
        time.sleep(0.01)

stopping = Stopping()
try:
    with stopping.asking_master():
        Left()
        time.sleep(600)  # as a master that hangs
finally:
    assert stopping.is_set()
    assert signal.getitimer(signal.ITIMER_REAL) == (0, 0)
    print("left", flush=True)
"""

AS_IT_IS_LEFT = """
import os, signal, sys, time
from oracle_ros1.stopping import Stopping

stopping = Stopping()
never_left = stopping.asking_master()
never_left.__enter__()
try:
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(600)
except SystemExit:
    stopping.calm()
    assert signal.getitimer(signal.ITIMER_REAL) == (0, 0)
    os.kill(os.getpid(), signal.SIGTERM)
    os.kill(os.getpid(), signal.SIGALRM)
    print("settled", flush=True)
os._exit(0)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_that_comes_within_a_destructor_ends_what_waits_for_the_master(
    number: signal.Signals, tmp_path: Path
) -> None:
    with Scene(tmp_path) as scene:
        program = scene.run("program", sys.executable, "-c", WITHIN_A_DESTRUCTOR, int(number))
        assert program.wait() == 0
        assert program.log == "left\n"


def test_what_is_settled_at_the_end_is_not_interrupted(tmp_path: Path) -> None:
    """Where the signal came when the master had answered, and `asking_master` was not left yet."""
    with Scene(tmp_path) as scene:
        program = scene.run("program", sys.executable, "-c", AS_IT_IS_LEFT)
        assert program.wait() == 0
        assert program.log == "settled\n"
